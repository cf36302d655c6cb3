# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Speed and error of the simulator, hard cases, and comparison with MuJoCo."""
