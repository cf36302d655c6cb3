# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings of other software as labelled trials: arrays, tables, and bags without our events."""
