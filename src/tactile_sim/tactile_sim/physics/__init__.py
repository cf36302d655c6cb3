# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Equations of the rig: finger, contact, sensor, and the solver that steps them."""
