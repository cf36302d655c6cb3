# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files of a bag: MCAP, SQLite and their metadata, from untrusted input."""
