# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Memory, signals and DDS transports of a process with nodes."""

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
"""Options of mallopt(3)."""

LARGE_BYTES = 128 * 1024
"""Smallest block that is mapped separately [B]; the initial value of glibc."""


@cache
def share_one_heap() -> None:
    """Make all threads that are started later use one heap for small blocks.

    Must be called before NumPy and rclpy are imported, because threads that they start would get
    separate heaps. The environment variable of glibc takes precedence. Has no effect without
    glibc.
    """
    _set_option('MALLOC_ARENA_MAX', M_ARENA_MAX, 1)


@cache
def keep_heap_small() -> None:
    """Share one heap, and return large blocks to the system when they are freed.

    Must be called before ROS starts its threads. By default, glibc raises the size from which
    blocks are mapped separately to the size of the largest freed block. The buffers of a recorder
    were then placed between the small blocks of 16 heaps, which grew by 40 MB per hour; with
    mapped buffers they grow by 2 MB (``benchmarks/nodes/soak.py``). Programs that only compute
    should not use this, because mapping every array made an evaluation 5 % slower.
    """
    share_one_heap()
    _set_option('MALLOC_MMAP_THRESHOLD_', M_MMAP_THRESHOLD, LARGE_BYTES)


@contextmanager
def short_collections() -> Iterator[None]:
    """Keep garbage collections short within the block: they skip all objects that exist already.

    A full collection stops all threads, for 0.06 to 0.3 s in a process that has trained a model;
    a heartbeat may be 0.4 s late. Has no effect if objects are skipped already.
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
"""Signals that end a process in an orderly way. A terminal sends SIGHUP when it is closed."""

INTERRUPT_TIMEOUT_S = 10.0
"""Longest wait for interrupted work to end [s]."""

ENDS_WITHIN_S = 30.0
"""Longest time from a signal to the end of the process [s]; see `Signals`."""

STDERR = 2
"""Descriptor of the standard error, because a program may have closed `sys.stderr`."""

REPEAT_S = 0.05
"""Pause between two attempts to interrupt the main thread."""

Result = TypeVar('Result')


class Signals:
    """The signals received since `hold_signals`.

    If the process has not ended `ENDS_WITHIN_S` after the last signal, it hangs, for example in
    Fast DDS. It is then ended with exit code 1 and a traceback.

    Attributes
    ----------
    received : int
        Number of the first received signal; 0 if there is none.
    """

    def __init__(self) -> None:
        self.received = 0
        self._raises = False
        self._read_end, self._write_end = os.pipe()
        for end in (self._read_end, self._write_end):
            os.set_blocking(end, False)
        for number in NUMBERS:
            # Under nohup, SIGHUP is ignored and must remain so.
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
            self._raises = False  # only once, so that the clean-up is not interrupted
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
        """End a `wait` from another thread."""
        with suppress(BlockingIOError):  # a full pipe also ends the wait
            os.write(self._write_end, b'\0')

    def run(self, work: Callable[[], Result], interrupt: Callable[[], object]) -> Result | None:
        """Run ``work()`` on a separate thread; return its result or raise its exception.

        After a signal, ``interrupt()`` is called on this thread, and the work has
        `INTERRUPT_TIMEOUT_S` to end. Return None if it does not end, or if a signal was received
        before it started.
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

        The interpreter runs signal handlers between two instructions. A signal that arrives just
        before a long wait would take effect after it, so a thread interrupts the main thread
        repeatedly until the handler has run. Later signals have no effect.
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
        """Within `raising`, delay a signal until the end of this block."""
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

    The signals no longer end the process: use `Signals.received` or `Signals.wait`.
    """
    global _signals
    if _signals is None:
        _signals = Signals()
    return _signals


def held_signals() -> Signals | None:
    """Return the `Signals` of this process, or None before `hold_signals` was called."""
    return _signals


def uninterrupted() -> AbstractContextManager[None]:
    """Within `Signals.raising`, delay a signal until the end of the block."""
    is_main = threading.current_thread() is threading.main_thread()
    return _signals.holding() if _signals is not None and is_main else nullcontext()


def ignore_signals() -> None:
    """Ignore further signals, so that they do not change the exit code of an ending process.

    At its end, the interpreter restores the default handlers, which would kill the process.
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
"""Signals with which a terminal stops a process: on Ctrl-Z, and on output in the background."""


@contextmanager
def ignoring_terminal_stops() -> Iterator[None]:
    """Ignore the signals with which a terminal stops a process, until the block ends.

    Used for processes with nodes, because a stopped driver monitors nothing. Has no effect on
    other threads than the main thread.
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
"""Environment variable that names a file with profiles of Fast DDS, for each ROS distribution."""

LOOPBACK = Path(__file__).parent / 'loopback.xml'
"""A Fast DDS profile that uses only UDP on the loopback interface."""


def choose_transports(environment: Mapping[str, str], default_range: str) -> dict[str, str]:
    """Return the environment variables to set before ROS starts.

    The user's own settings are kept. ``default_range`` is used if
    ``ROS_AUTOMATIC_DISCOVERY_RANGE`` is not set.
    """
    if any(environment.get(name) for name in PROFILES):
        return {}  # a profile of the user selects transports and range
    chosen_range = environment.get(RANGE) or default_range
    if chosen_range != 'LOCALHOST':
        return {} if environment.get(TRANSPORTS) else {TRANSPORTS: 'UDPv4'}
    variable = PROFILES_OF.get(environment.get('ROS_DISTRO', ''))
    if variable is None or 'fastrtps' not in environment.get('RMW_IMPLEMENTATION', ''):
        return {RANGE: chosen_range}  # it is not certain that the profile would be read
    # In the range LOCALHOST, ROS would also use shared memory. The profile, too, limits discovery
    # to this host.
    return {RANGE: 'SUBNET', variable: str(LOOPBACK)}
