# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated devices that speak the real wire protocols, and their faults."""
