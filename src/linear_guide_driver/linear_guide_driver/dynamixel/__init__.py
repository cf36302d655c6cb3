# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tendon actuator: a Dynamixel servo over a serial line."""
