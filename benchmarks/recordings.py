# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Folder of the public recordings that docs/real_recordings.md names."""

from __future__ import annotations

import os
from pathlib import Path

FABRIC_SLIDE = 'fabric_slide.npz'
PHAC_HOLD = 'phac_hold.npz'


def find_recording(name: str) -> Path | None:
    """Return the file in the folder that the environment's TACTILE_DATA names, if it is there."""
    path = Path(os.environ.get('TACTILE_DATA', '')) / name
    return path if path.is_file() else None


def say_missing(name: str) -> str:
    """Return what to do where a recording is missing."""
    return f'{name} is missing: set TACTILE_DATA to the folder that has it'
