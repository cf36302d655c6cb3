# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether a recorded trial is whole: samples, gaps, clocks."""
