# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""An experiment: a plan of trials, its journal, and the trials one after the other."""
