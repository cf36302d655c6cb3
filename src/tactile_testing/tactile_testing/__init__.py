# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Helpers and fixtures that the tests of several packages use. No program imports them."""
