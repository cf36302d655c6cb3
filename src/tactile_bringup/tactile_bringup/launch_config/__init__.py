# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Configuration of the nodes of launch files and commands: parameters, fingers, models."""
