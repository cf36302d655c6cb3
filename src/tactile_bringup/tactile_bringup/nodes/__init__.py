# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The nodes of this package, and functions that run nodes in one process."""
