# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What each subcommand of ``tactile`` does; `tactile_lab.cli` holds their help.

`analysis` holds those on recordings of many trials, `running` those that run nodes.
"""
