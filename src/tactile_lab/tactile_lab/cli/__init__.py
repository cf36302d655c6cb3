# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Commands that have no module of their own in `tactile_lab.commands` yet."""
