# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Benchmarks of the accuracy of features and classifiers, compared with other libraries."""
