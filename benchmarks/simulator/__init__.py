# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Benchmarks of the simulator: speed, error, degraded conditions, and comparison with MuJoCo."""
