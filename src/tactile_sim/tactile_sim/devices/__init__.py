# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Devices that speak the real wire protocols, and the faults they can be given."""
