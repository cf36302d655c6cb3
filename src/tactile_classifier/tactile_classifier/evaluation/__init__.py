# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy with intervals: cross-validation, significance, rejection of unknown objects."""
