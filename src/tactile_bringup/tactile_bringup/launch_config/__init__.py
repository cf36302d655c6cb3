# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nodes of launch files and commands: parameters, fingers of a hand, models."""
