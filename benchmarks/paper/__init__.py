# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reproduction of the paper on SIMULATED trials, compared with its published numbers.

- `protocol`: trials, features, classifiers and cross-validation as described in the paper.
- `statements`: numbers in the text of the paper, and rules for agreement with them.
- `reproduction`: tables of ``python -m benchmarks --only paper``.
- `settings`: agreement with the statements if one setting is changed.
- `figures`: figures 8 to 10 of the paper for these trials.
"""
