# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands of ``tactile``, one module each; `tactile_lab.program` has their table."""
