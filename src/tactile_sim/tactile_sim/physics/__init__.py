# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Equations of finger, contact and sensor, and the solver that computes their motion in time."""
