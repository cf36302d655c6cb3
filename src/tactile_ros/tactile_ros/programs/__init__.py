# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Programs that run nodes: transports, signals, groups of nodes."""
