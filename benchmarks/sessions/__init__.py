# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Benchmarks of the thresholds for unknown objects, in new simulated sessions."""
