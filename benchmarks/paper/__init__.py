# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The paper's protocol on SIMULATED trials, beside its published numbers.

- `protocol`: trials, features, classifiers and cross-validation as the paper describes them.
- `statements`: the numbers of the paper's text, and rules by which trials agree with them.
- `reproduction`: the tables of ``python -m benchmarks --only paper``.
- `settings`: the statements again, with one setting changed at a time.
- `figures`: the paper's figures 8 to 10 of the same trials.
"""
