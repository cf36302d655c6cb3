# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Public recordings listed in docs/real_recordings.md."""

from __future__ import annotations

import os
from pathlib import Path

FABRIC_SLIDE = 'fabric_slide.npz'
PHAC_HOLD = 'phac_hold.npz'


def find_recording(name: str) -> Path | None:
    """Return the file in the folder of the environment variable TACTILE_DATA, or None."""
    path = Path(os.environ.get('TACTILE_DATA', '')) / name
    return path if path.is_file() else None


def say_missing(name: str) -> str:
    """Return the remedy for a missing recording."""
    return f'{name} is missing: set TACTILE_DATA to the folder that contains it'
