# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Labelled trials from recordings of other software: arrays, tables and bags."""
