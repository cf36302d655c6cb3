# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of a process with nodes: memory allocation, signal handlers and DDS transports."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
import ctypes
import faulthandler
from functools import cache
import gc
import os
from pathlib import Path
import select
import signal
import threading
from types import FrameType
from typing import TypeVar

M_MMAP_THRESHOLD, M_ARENA_MAX = -3, -8
"""Numbers of two options of the C function mallopt(3)."""

LARGE_BYTES = 128 * 1024
"""Size from which glibc allocates a block of memory by a separate mmap [B]. This is also the
initial value of glibc, which it otherwise increases."""


@cache
def share_one_heap() -> None:
    """Make all threads that are started later use one heap for small blocks.

    Must be called before NumPy and rclpy are imported, because threads that they start would get
    separate heaps. It has no effect without glibc, or if the environment variable
    ``MALLOC_ARENA_MAX`` is set.
    """
    _set_option('MALLOC_ARENA_MAX', M_ARENA_MAX, 1)


@cache
def keep_heap_small() -> None:
    """Share one heap, and return large blocks to the system when they are freed.

    Must be called before ROS starts its threads. Blocks that are larger than a threshold are
    allocated by a separate mmap. By default, glibc increases this threshold to the size of the
    largest freed block. The buffers of the bag recorder were then placed between the small blocks
    of 16 heaps, so that the memory of its process grew by 40 MB per hour. With a constant
    threshold, it grows by 2 MB per hour (``benchmarks/nodes/soak.py``). Programs that only compute
    should not call this function, because it made an evaluation of models 5 % slower.
    """
    share_one_heap()
    _set_option('MALLOC_MMAP_THRESHOLD_', M_MMAP_THRESHOLD, LARGE_BYTES)


@contextmanager
def short_collections() -> Iterator[None]:
    """Shorten garbage collections within the ``with`` block: they skip all existing objects.

    A full collection stops all threads, for 0.06 to 0.3 s in a process that has trained a model,
    but a heartbeat may be at most 0.4 s late. This function has no effect within another such
    block.
    """
    if gc.get_freeze_count():
        yield
        return
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def _set_option(variable: str, option: int, value: int) -> None:
    if variable not in os.environ:
        with suppress(AttributeError, OSError):
            ctypes.CDLL(None).mallopt(option, value)


NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that request the end of the process. A terminal sends SIGHUP when it is closed."""

INTERRUPT_TIMEOUT_S = 10.0
"""Longest time for which `Signals.run` waits until interrupted work has ended [s]."""

ENDS_WITHIN_S = 30.0
"""Time after a signal at which a process that has not ended is terminated [s]; see `Signals`."""

STDERR = 2
"""File descriptor of the standard error. It is used because `sys.stderr` may be closed."""

REPEAT_S = 0.05
"""Time between two attempts to interrupt the main thread [s]; see `Signals.raising`."""

Result = TypeVar('Result')


class Signals:
    """Handles the signals in `NUMBERS`, and stores that one was received.

    If the process has not ended `ENDS_WITHIN_S` after the last signal, it hangs, for example in
    Fast DDS. It is then ended with exit code 1 and a traceback.

    Attributes
    ----------
    received : int
        Number of the first signal that was received, such as 2 for SIGINT; 0 before a signal.
    """

    def __init__(self) -> None:
        self.received = 0
        self._raises = False
        self._read_end, self._write_end = os.pipe()
        for end in (self._read_end, self._write_end):
            os.set_blocking(end, False)
        for number in NUMBERS:
            # The command nohup ignores SIGHUP, and the signal must remain ignored.
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._take)
        signal.set_wakeup_fd(self._write_end, warn_on_full_buffer=False)
        os.register_at_fork(
            before=lambda: signal.pthread_sigmask(signal.SIG_BLOCK, NUMBERS),
            after_in_parent=lambda: signal.pthread_sigmask(signal.SIG_UNBLOCK, NUMBERS),
            after_in_child=_restore_in_child,
        )

    def _take(self, number: int, frame: FrameType | None) -> None:
        self.received = self.received or number
        faulthandler.dump_traceback_later(ENDS_WITHIN_S, exit=True, file=STDERR)
        if self._raises:
            self._raises = False  # another signal must not interrupt the clean-up
            raise KeyboardInterrupt

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for a signal, a call of `wake`, or a timeout [s]; return True after a signal."""
        if not self.received:
            select.select([self._read_end], [], [], timeout_s)
            self._read()
        return bool(self.received)

    def _read(self) -> None:
        with suppress(BlockingIOError):
            for number in os.read(self._read_end, 4096):
                self.received = self.received or number

    def wake(self) -> None:
        """End a call of `wait` on another thread."""
        with suppress(BlockingIOError):  # if the pipe is full, `wait` ends anyway
            os.write(self._write_end, b'\0')

    def run(self, work: Callable[[], Result], interrupt: Callable[[], object]) -> Result | None:
        """Run ``work()`` on a separate thread; return its result or raise its exception.

        After a signal, ``interrupt()`` is called on this thread. It must cause the work to end
        within `INTERRUPT_TIMEOUT_S`. Return None if the work does not end within this time, or if
        a signal was received before the start.
        """
        results: list[Result] = []
        errors: list[BaseException] = []
        if self.received:
            return None

        def run() -> None:
            try:
                results.append(work())
            except BaseException as error:
                errors.append(error)
            self.wake()

        thread = threading.Thread(target=run, name='interruptible', daemon=True)
        thread.start()
        while not (results or errors) and not self.wait():
            pass
        if self.received:
            interrupt()
            thread.join(INTERRUPT_TIMEOUT_S)
        if errors:
            raise errors[0]
        return results[0] if results else None

    @contextmanager
    def raising(self) -> Iterator[None]:
        """Raise KeyboardInterrupt in the main thread at the first signal within the block.

        Python runs a signal handler only between two instructions. If a signal arrives just before
        a long system call, its handler would run only after this call. Therefore, a helper thread
        interrupts the main thread repeatedly until the handler has run. Later signals have no
        effect.
        """
        over = threading.Event()
        thread = threading.Thread(target=self._repeat, args=(over,), daemon=True)
        self._raises = True
        try:
            if self.received:
                self._take(self.received, None)
            thread.start()
            yield
        finally:
            self._raises = False
            over.set()

    @contextmanager
    def holding(self) -> Iterator[None]:
        """Delay the KeyboardInterrupt of `raising` until the end of this ``with`` block."""
        raises, self._raises = self._raises, False
        try:
            yield
        finally:
            self._raises = raises
            if raises and self.received:
                self._take(self.received, None)

    def _repeat(self, over: threading.Event) -> None:
        main = threading.main_thread().ident
        assert main is not None
        while not over.is_set():
            if select.select([self._read_end], [], [], REPEAT_S)[0]:
                self._read()
            if self.received and self._raises:
                signal.pthread_kill(main, self.received)
                over.wait(REPEAT_S)


_signals: Signals | None = None


def hold_signals() -> Signals:
    """Handle the signals `NUMBERS` for the rest of this process; call this on the main thread.

    The signals no longer end the process. The program must check `Signals.received`, or use one of
    the methods of `Signals`.
    """
    global _signals
    if _signals is None:
        _signals = Signals()
    return _signals


def held_signals() -> Signals | None:
    """Return the `Signals` of this process, or None before `hold_signals` was called."""
    return _signals


def uninterrupted() -> AbstractContextManager[None]:
    """Return a context manager that delays the KeyboardInterrupt of `Signals.raising`."""
    is_main = threading.current_thread() is threading.main_thread()
    return _signals.holding() if _signals is not None and is_main else nullcontext()


def ignore_signals() -> None:
    """Ignore further signals, so that they do not change the exit code of an ending process.

    When the interpreter ends, it restores the default handlers, with which a signal would kill the
    process.
    """
    for number in NUMBERS:
        signal.signal(number, signal.SIG_IGN)


def _restore_in_child() -> None:
    """Restore the default handlers in a forked child, and detach it from its parent's pipe."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, NUMBERS)


STOPS = (signal.SIGTSTP, signal.SIGTTOU)
"""Signals with which a terminal suspends a process: after Ctrl-Z, and when a process in the
background writes to the terminal."""


@contextmanager
def ignoring_terminal_stops() -> Iterator[None]:
    """Ignore the signals with which a terminal suspends a process, during a ``with`` block.

    Processes with nodes use this, because a suspended driver does not monitor its device. It has
    an effect only if the main thread calls it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, signal.SIG_IGN) for number in STOPS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'
PROFILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
PROFILES_OF = {'jazzy': PROFILES[1], 'kilted': PROFILES[0], 'lyrical': PROFILES[0]}
"""For each ROS distribution, the environment variable with the path of the user's Fast DDS
profiles."""

LOOPBACK = Path(__file__).parent / 'loopback.xml'
"""A Fast DDS profile that uses only UDP on the loopback interface."""


def choose_transports(environment: Mapping[str, str], default_range: str) -> dict[str, str]:
    """Return the environment variables to set before ROS starts.

    The user's own settings are kept. ``default_range`` is used if
    ``ROS_AUTOMATIC_DISCOVERY_RANGE`` is not set.
    """
    if any(environment.get(name) for name in PROFILES):
        return {}  # the user's profile selects the transports and the discovery range
    chosen_range = environment.get(RANGE) or default_range
    if chosen_range != 'LOCALHOST':
        return {} if environment.get(TRANSPORTS) else {TRANSPORTS: 'UDPv4'}
    variable = PROFILES_OF.get(environment.get('ROS_DISTRO', ''))
    if variable is None or 'fastrtps' not in environment.get('RMW_IMPLEMENTATION', ''):
        return {RANGE: chosen_range}  # this middleware might not read `LOOPBACK`
    # With the range LOCALHOST, ROS would use shared memory in addition to UDP. The profile
    # `LOOPBACK` limits discovery to this host without that.
    return {RANGE: 'SUBNET', variable: str(LOOPBACK)}
