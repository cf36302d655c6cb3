# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of this package; each message is a sentence for the user."""

from tactile_ros.errors import TactileError


class BagError(TactileError):
    """A bag cannot be read or written."""


class BagDamageError(BagError):
    """A bag is damaged; the messages before the damage have been read."""
