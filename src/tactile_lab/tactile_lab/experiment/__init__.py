# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Experiments: a plan of trials, its journal, and the loop that runs the trials."""
