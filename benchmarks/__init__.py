# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Benchmarks of speed, error and accuracy; see docs/benchmarks.md."""
