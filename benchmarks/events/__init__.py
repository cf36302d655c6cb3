# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is found in simulated trials: pitch, presses, slip, phases."""
