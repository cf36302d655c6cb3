# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration of probabilities, and detection of unknown objects."""
