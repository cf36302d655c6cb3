# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Cuts the tension stream into windows and computes texture and stiffness features."""
