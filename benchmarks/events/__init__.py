# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Benchmarks of the detection of phases in the tension of simulated trials."""
