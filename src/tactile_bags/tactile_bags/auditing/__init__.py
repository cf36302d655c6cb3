# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Audits of recorded trials: lost samples, gaps, clock steps."""
