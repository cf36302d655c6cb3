# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files of recordings, from their new place."""

from tactile_bags.sources.files import find_leaves, Kind, Leaf

__all__ = ['Kind', 'Leaf', 'find_leaves']
