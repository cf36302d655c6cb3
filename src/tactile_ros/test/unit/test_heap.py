# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Large blocks of memory are returned to the system; small blocks of all threads share a heap."""

import ctypes
import os
import subprocess
import sys

import pytest

PROGRAM = """
import ctypes, sys, threading
from tactile_ros.process import keep_heap_small

class Mallinfo(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in (
        'arena', 'ordblks', 'smblks', 'hblks', 'hblkhd', 'usmblks', 'fsmblks', 'uordblks',
        'fordblks', 'keepcost')]

libc = ctypes.CDLL(None)
libc.mallinfo2.restype = Mallinfo
libc.malloc.restype = libc.fdopen.restype = ctypes.c_void_p
if 'limit' in sys.argv:
    keep_heap_small()
libc.free(ctypes.c_void_p(libc.malloc(8_000_000)))
mapped = libc.mallinfo2().hblks
libc.malloc(4_000_000)
print(libc.mallinfo2().hblks - mapped, flush=True)
met = threading.Barrier(5)
for _ in range(4):
    threading.Thread(target=lambda: (libc.malloc(5000), met.wait(), met.wait())).start()
met.wait()
out = ctypes.c_void_p(libc.fdopen(1, b'w'))
libc.malloc_info(0, out)
libc.fflush(out)
met.wait()
"""


def measure(*arguments, **variables):
    """Run a program; return its number of mapped blocks, and whether it has several heaps."""
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM, *arguments],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    mapped, _, heaps = done.stdout.partition('\n')
    return int(mapped), heaps.count('<heap nr=') > 1


def test_freed_blocks_go_back_and_threads_share_one_heap_unless_the_user_wants_it_otherwise():
    if not hasattr(ctypes.CDLL(None), 'mallinfo2'):
        pytest.skip('this C library is not glibc from 2.33 on')
    assert measure() == (0, True)
    assert measure('limit') == (1, False)
    users = {'MALLOC_MMAP_THRESHOLD_': str(32 * 1024 * 1024), 'MALLOC_ARENA_MAX': '8'}
    assert measure('limit', **users) == (0, True)
