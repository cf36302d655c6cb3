# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The evaluation of recordings as one page.

- `recordings`, `analysis`, `answers`: sets of trials and their results, without matplotlib.
- `summary`, `significance`: results in words.
- `drawings`, `svg`: figures with text alternatives.
- `build`: the HTML file, from the templates of the folder ``templates``.
"""
