# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Helpers and fixtures of the tests of several packages; no program imports them."""
