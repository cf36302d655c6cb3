# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Watchdog process that kills its parent when the parent's worker thread hangs.

A process that is stopped (``SIGSTOP``), or whose threads block, reacts only to ``SIGKILL``, and
launch restarts a node only after it has died. The node therefore starts this file as a child
process, to which its worker writes through a pipe in each cycle. The child ends when the pipe is
closed. It imports only a few core modules, needs 4 MB, and wakes up about eight times a second.
It runs in a separate session, so that Ctrl-Z, or a signal to the parent's process group, does not
stop it together with the parent.
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
"""Format of a message through the pipe: the longest time until the next message [s], which is
infinite if no further message is expected."""

_SLICES = 4
"""Number of parts into which the child divides a timeout. A part that takes too long still counts
as one part: if the child did not get a core, the parent may not have got one either."""


class HangWatch:
    """Starts the watchdog process, and tells it that the worker of this process still runs.

    Parameters
    ----------
    timeout_s : float
        This process is killed if `feed` is not called for this time [s]. The time is measured
        from the first call of `feed`.
    """

    def __init__(self, timeout_s: float) -> None:
        import subprocess  # imported here to save 1 MB in the child

        self._timeout_s = timeout_s
        self._due_s = 0.0
        self._lock = threading.Lock()
        reader, writer = os.pipe()
        self._writer: int | None = writer
        os.set_blocking(writer, False)  # so that a hanging child cannot block the worker
        # The child inherits the signal mask, so signals that end the parent do not end the child.
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

    def feed(self, pause_s: float = 0.0) -> None:
        """Feed the watchdog; must be called in each cycle of the worker.

        ``pause_s`` is the time by which the next cycle may be delayed [s]; infinite in the last
        cycle. The call has no effect if the child has died.
        """
        now_s = time.monotonic()
        if not pause_s and now_s < self._due_s:
            return
        self._due_s = now_s + self._timeout_s / _SLICES
        with self._lock, suppress(BlockingIOError, BrokenPipeError):
            if self._writer is not None:
                os.write(self._writer, _ALLOWANCE.pack(self._timeout_s + pause_s))

    def close(self) -> None:
        """End the child; idempotent."""
        with self._lock:
            if self._writer is None:
                return
            os.close(self._writer)
            self._writer = None
        self._child.wait()


def watch(parent: int, pipe: int) -> None:
    """Kill the parent if no message arrives in time; return when the pipe is closed."""
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
                f'Process {parent} has hung for {allowance_s:g} s and is killed, so that launch '
                'can restart it. Set hang_timeout_s to 0 to turn this off, for example under a '
                'debugger.\n'
            )
            sys.stderr.flush()
            os.kill(parent, signal.SIGKILL)
            return


if __name__ == '__main__':
    watch(int(sys.argv[1]), int(sys.argv[2]))
