# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Base classes and parts of the nodes: lifecycle, parameters, message guard, goals, requests."""
