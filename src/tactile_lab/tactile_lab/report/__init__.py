# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The evaluation of recordings as one page: analyses, figures, HTML."""
