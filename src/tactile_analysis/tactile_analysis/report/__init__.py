# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The evaluation of recordings as an HTML page.

- `recordings`, `analysis`: sets of trials and their results. These modules do not import
  matplotlib.
- `summary`, `significance`: results as sentences.
- `drawings`, `svg`: figures with text alternatives.
- `build`: the HTML file, from the templates in the folder ``templates``.
"""
