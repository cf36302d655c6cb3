# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Benchmarks of speed and error of features, significance tests and model files."""
