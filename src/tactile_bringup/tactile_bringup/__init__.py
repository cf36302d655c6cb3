# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Trial runner, bag recording and replay, launch files and the tactile command."""
