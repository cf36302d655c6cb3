# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Notes on recordings, from their new place."""

from tactile_bags.sources.files import Notes as Questions
from tactile_bags.sources.files import SourceError

__all__ = ['Questions', 'SourceError']
