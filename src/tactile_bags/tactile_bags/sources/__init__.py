# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings that others made, as labelled trials: arrays, tables, bags without our events."""
