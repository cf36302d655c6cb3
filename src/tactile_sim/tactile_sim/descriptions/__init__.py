# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Descriptions of fingers, rig, plates and objects, which are read from YAML files."""
