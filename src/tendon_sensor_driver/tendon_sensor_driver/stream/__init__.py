# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""From readings to a stream of samples: clock, sequence, calibration, tare."""
