# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reads the force sensor on the tendon and publishes the tension as strain blocks."""
