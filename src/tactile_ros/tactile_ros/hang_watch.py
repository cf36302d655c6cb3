# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A small process that kills its parent when the parent's worker hangs.

A process that is stopped (``SIGSTOP``) or whose threads block heeds no signal but ``SIGKILL``, and
a launch starts only a dead node again. So the node starts this file as a child of its own and
tells it, through a pipe, each time that its worker comes round. The child ends with the pipe. It
imports a few core modules only: 4 MB, and some eight wake-ups a second. It has a session of its
own, so that neither Ctrl-Z nor a signal to the parent's process group stops both.
"""

from __future__ import annotations

from contextlib import suppress
import os
import select
import signal
import struct
import sys
import threading
import time

_ALLOWANCE = struct.Struct('d')
"""One message: time until the next one [s]; infinite: there is none."""

_SLICES = 4
"""The child waits in so many slices, and counts each as one, however long it took: where the
child got no core, the parent may have got none either."""


class HangWatch:
    """Starts the child, and tells it that the worker turns.

    After ``timeout_s`` without `turn` the process is killed [s]. It counts from the first.
    """

    def __init__(self, timeout_s: float) -> None:
        import subprocess  # the child does without its megabyte

        self._timeout_s = timeout_s
        self._due_s = 0.0
        self._lock = threading.Lock()
        reader, writer = os.pipe()
        self._writer: int | None = writer
        os.set_blocking(writer, False)  # a child that hangs must not stop the worker
        # The child inherits the mask: a signal to all is no reason to leave the parent alone.
        blocked = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, blocked)
        try:
            self._child = subprocess.Popen(
                [sys.executable, '-I', '-S', __file__, str(os.getpid()), str(reader)],
                pass_fds=[reader],
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            os.close(reader)

    def turn(self, pause_s: float = 0.0) -> None:
        """Note that the worker has come round.

        ``pause_s`` is how much longer than usual the next turn may take [s]; infinite: there is
        none. Without the child, as when somebody has killed it, this does nothing.
        """
        now_s = time.monotonic()
        if not pause_s and now_s < self._due_s:
            return
        self._due_s = now_s + self._timeout_s / _SLICES
        with self._lock, suppress(BlockingIOError, BrokenPipeError):
            if self._writer is not None:
                os.write(self._writer, _ALLOWANCE.pack(self._timeout_s + pause_s))

    def close(self) -> None:
        """End the child; harmless when called twice."""
        with self._lock:
            if self._writer is None:
                return
            os.close(self._writer)
            self._writer = None
        self._child.wait()


def watch(parent: int, pipe: int) -> None:
    """Kill the parent when no message comes in time; return when the pipe is closed."""
    slice_s: float | None = None
    silent = 0
    while True:
        if select.select([pipe], [], [], slice_s)[0]:
            data = os.read(pipe, 512 * _ALLOWANCE.size)
            if not data:
                return
            (allowance_s,) = _ALLOWANCE.unpack(data[-_ALLOWANCE.size :])
            slice_s = None if allowance_s == float('inf') else allowance_s / _SLICES
            silent = 0
            continue
        silent += 1
        if silent >= _SLICES and os.getppid() == parent:
            sys.stderr.write(
                f'Process {parent} has hung for {allowance_s:g} s and is killed, so that its '
                'launch starts it again. hang_timeout_s:=0 leaves it alone, as under a debugger.\n'
            )
            sys.stderr.flush()
            os.kill(parent, signal.SIGKILL)
            return


if __name__ == '__main__':
    watch(int(sys.argv[1]), int(sys.argv[2]))
