# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Where the public recordings are that docs/real_recordings.md names."""

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
