# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Large blocks go back to the system when they are freed; small ones share one heap."""

import ctypes
import os
import subprocess
import sys

import pytest

PROGRAM = """
import ctypes, sys
from tactile_ros.process import keep_heap_small

class Mallinfo(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in (
        'arena', 'ordblks', 'smblks', 'hblks', 'hblkhd', 'usmblks', 'fsmblks', 'uordblks',
        'fordblks', 'keepcost')]

libc = ctypes.CDLL(None)
libc.mallinfo2.restype = Mallinfo
libc.malloc.restype = ctypes.c_void_p
if 'limit' in sys.argv:
    keep_heap_small()
libc.free(ctypes.c_void_p(libc.malloc(8_000_000)))
mapped = libc.mallinfo2().hblks
libc.malloc(4_000_000)
print(libc.mallinfo2().hblks - mapped)
"""


def run_program(program, *arguments, **variables):
    done = subprocess.run(
        [sys.executable, '-c', program, *arguments],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    return done.stdout


def blocks_mapped_after_a_larger_one(*arguments, **variables):
    return int(run_program(PROGRAM, *arguments, **variables))


def test_freed_blocks_do_not_move_later_ones_into_the_heaps():
    if not hasattr(ctypes.CDLL(None), 'mallinfo2'):
        pytest.skip('this C library is not glibc from 2.33 on')
    assert blocks_mapped_after_a_larger_one() == 0
    assert blocks_mapped_after_a_larger_one('limit') == 1
    users = str(32 * 1024 * 1024)
    assert blocks_mapped_after_a_larger_one('limit', MALLOC_MMAP_THRESHOLD_=users) == 0


HEAPS = """
import ctypes, sys, threading
from tactile_ros.process import keep_heap_small

libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
if 'limit' in sys.argv:
    keep_heap_small()
met = threading.Barrier(5)
for _ in range(4):
    threading.Thread(target=lambda: (libc.malloc(5000), met.wait(), met.wait())).start()
met.wait()
libc.fdopen.restype = ctypes.c_void_p
out = ctypes.c_void_p(libc.fdopen(1, b'w'))
libc.malloc_info(0, out)
libc.fflush(out)
met.wait()
"""


def heaps_of_five_threads(*arguments, **variables):
    return run_program(HEAPS, *arguments, **variables).count('<heap nr=')


def test_threads_share_one_heap():
    if not hasattr(ctypes.CDLL(None), 'malloc_info'):
        pytest.skip('this C library is not glibc')
    assert heaps_of_five_threads() > 1
    assert heaps_of_five_threads('limit') == 1
    assert heaps_of_five_threads('limit', MALLOC_ARENA_MAX='8') > 1
