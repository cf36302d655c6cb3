# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""From launch arguments, hand files and models to nodes with parameters, and to running them."""
