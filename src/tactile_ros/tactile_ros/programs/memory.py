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

"""Memory of a process that runs for hours."""

from __future__ import annotations

from contextlib import suppress
import ctypes
import os

M_MMAP_THRESHOLD = -3
"""Option of mallopt(3)."""

LARGE_BYTES = 128 * 1024
"""Blocks from this size on are mapped, each by itself: glibc's own initial value."""


def limit_memory() -> None:
    """Keep the process's memory flat; call it before NumPy is loaded.

    OpenBLAS gets one thread: each has memory of its own, and our matrices are small.

    Large blocks go back to the system when they are freed. By itself glibc raises the size from
    which it maps a block to the largest that was freed, so a recorder's buffers came to lie
    among the small blocks of 16 heaps, which grew by 40 MB an hour while no more was in use
    (``benchmarks/soak.py``). What the user has set in the environment stays. Without glibc
    this does nothing.
    """
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    if 'MALLOC_MMAP_THRESHOLD_' not in os.environ:
        with suppress(AttributeError, OSError):
            ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE_BYTES)
