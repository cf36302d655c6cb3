# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Memory of a process that runs for hours."""

from __future__ import annotations

from contextlib import suppress
import ctypes
from functools import cache
import os

M_MMAP_THRESHOLD, M_ARENA_MAX = -3, -8
"""Options of mallopt(3)."""

LARGE_BYTES = 128 * 1024
"""Blocks from this size on are mapped, each by itself: glibc's own initial value."""


@cache
def share_one_heap() -> None:
    """Let all threads that begin later take small blocks from one heap.

    Call it before NumPy and rclpy are imported: a thread that they start has a heap of its own
    otherwise, and later threads share that one, too. What the user has set in the environment
    stays. Without glibc this does nothing.
    """
    _set_option('MALLOC_ARENA_MAX', M_ARENA_MAX, 1)


@cache
def keep_heap_small() -> None:
    """Share one heap, and give large blocks back to the system when they are freed.

    Call it before ROS starts its threads. By itself glibc raises the size from which it maps a
    block to the largest that was freed, and has a heap for almost every thread. A recorder's
    buffers then lay among the small blocks of 16 heaps, which grew by 40 MB an hour while no more
    was in use; with mapped buffers they still grew by 2 MB an hour (``benchmarks/nodes/soak.py``).
    What the user has set in the environment stays. Without glibc this does nothing. Not for
    programs that only compute: their arrays would be mapped anew each time, which took an
    evaluation 5 % longer.
    """
    share_one_heap()
    _set_option('MALLOC_MMAP_THRESHOLD_', M_MMAP_THRESHOLD, LARGE_BYTES)


def _set_option(variable: str, option: int, value: int) -> None:
    """Set an option of malloc that the user has not set in the environment."""
    if variable not in os.environ:
        with suppress(AttributeError, OSError):
            ctypes.CDLL(None).mallopt(option, value)
