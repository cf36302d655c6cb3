# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated devices, which use the serial protocols of the real devices, and their faults."""
