# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Launch files, the graph of nodes, and the trial runner."""
