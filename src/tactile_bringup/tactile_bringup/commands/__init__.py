# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""What each subcommand of ``tactile`` does; `tactile_bringup.cli` holds their arguments."""
