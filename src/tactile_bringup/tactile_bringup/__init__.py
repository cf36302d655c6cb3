# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Launch files, configuration of nodes, and the trial runner."""
