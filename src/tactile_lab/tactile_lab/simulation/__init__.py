# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags of simulated trials, their pictures, and how robust answers on them are."""
