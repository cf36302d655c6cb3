# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy with its intervals: cross-validation, significance, unknown things, early answers."""
