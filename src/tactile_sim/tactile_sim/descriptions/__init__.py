# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finger, rig, plates and objects as YAML: reading, checking, and overriding."""
