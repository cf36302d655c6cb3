# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Implementations of the subcommands of ``tactile``; `tactile_lab.cli` holds their help.

`analysis` holds the commands on recordings of many trials, `running` those that run nodes.
"""
