# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The palpation rig as physics, and simulated devices that speak the real wire protocols."""
