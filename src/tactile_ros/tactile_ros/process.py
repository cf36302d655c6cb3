# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A process of nodes: its memory, its signals, its transports."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
import ctypes
import faulthandler
from functools import cache
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

    Call it before ROS starts its threads. glibc raises the size from which it maps a block to
    the largest that was freed, so a recorder's buffers lay among the small blocks of 16 heaps,
    which grew by 40 MB an hour; with mapped buffers by 2 MB (``benchmarks/nodes/soak.py``). Not
    for programs that only compute: their arrays would be mapped anew each time, which took an
    evaluation 5 % longer.
    """
    share_one_heap()
    _set_option('MALLOC_MMAP_THRESHOLD_', M_MMAP_THRESHOLD, LARGE_BYTES)


def _set_option(variable: str, option: int, value: int) -> None:
    if variable not in os.environ:
        with suppress(AttributeError, OSError):
            ctypes.CDLL(None).mallopt(option, value)


NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a process in order. A terminal sends SIGHUP when it is closed."""

INTERRUPT_TIMEOUT_S = 10.0
"""Longest wait for interrupted work to end [s]."""

ENDS_WITHIN_S = 30.0
"""After a signal the process has so long to end; see `Signals`."""

STDERR = 2
"""By number: a program may have closed its `sys.stderr`."""

REPEAT_S = 0.05
"""Pause between two attempts to interrupt the main thread."""

Result = TypeVar('Result')


class Signals:
    """The signals that have come since `hold_signals`.

    ``received`` is the number of the first one; 0 while there is none. A process that has not
    ended `ENDS_WITHIN_S` after the last one hangs, as Fast DDS can at its end. It is then ended
    with exit code 1 and a traceback.
    """

    def __init__(self) -> None:
        self.received = 0
        self._raises = False
        self._read_end, self._write_end = os.pipe()
        for end in (self._read_end, self._write_end):
            os.set_blocking(end, False)
        for number in NUMBERS:
            # nohup has SIGHUP ignored, and what it starts goes on without its terminal.
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._take)
        signal.set_wakeup_fd(self._write_end, warn_on_full_buffer=False)
        os.register_at_fork(
            before=lambda: signal.pthread_sigmask(signal.SIG_BLOCK, NUMBERS),
            after_in_parent=lambda: signal.pthread_sigmask(signal.SIG_UNBLOCK, NUMBERS),
            after_in_child=_give_back,
        )

    def _take(self, number: int, frame: FrameType | None) -> None:
        self.received = self.received or number
        faulthandler.dump_traceback_later(ENDS_WITHIN_S, exit=True, file=STDERR)
        if self._raises:
            self._raises = False  # once: nothing interrupts the clearing up
            raise KeyboardInterrupt

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for a signal, a `wake` or the time-out; return whether a signal has come."""
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
        with suppress(BlockingIOError):  # a full pipe ends the wait, too
            os.write(self._write_end, b'\0')

    def run(self, work: Callable[[], Result], interrupt: Callable[[], object]) -> Result | None:
        """Run ``work()`` on a thread of its own, and return what it returns or raise its error.

        When a signal comes, ``interrupt()`` is called on this thread, and the work has
        `INTERRUPT_TIMEOUT_S` to end. The result is None if it does not, or never began.
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

        The interpreter runs handlers between two instructions. A signal that comes just
        before a long wait would act after it, so a thread interrupts the main thread again
        until the handler has run. Later signals do nothing.
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
        """Within `raising`, let a signal wait for the end of this block."""
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
    """Take over `NUMBERS` for the rest of this process; call it on the main thread.

    Nothing happens by itself when one comes: ask `Signals.received`, `Signals.wait`.
    """
    global _signals
    if _signals is None:
        _signals = Signals()
    return _signals


def held_signals() -> Signals | None:
    """Return what `hold_signals` has returned in this process; None before."""
    return _signals


def uninterrupted() -> AbstractContextManager[None]:
    """Within `Signals.raising`, let a signal wait until a block has brought things to rest."""
    is_main = threading.current_thread() is threading.main_thread()
    return _signals.holding() if _signals is not None and is_main else nullcontext()


def ignore_signals() -> None:
    """Let no further signal spoil the exit code of a process that is ending.

    The interpreter gives signals their deadly default back before it is gone.
    """
    for number in NUMBERS:
        signal.signal(number, signal.SIG_IGN)


def _give_back() -> None:
    """Give a forked child the usual handlers, and leave its parent's pipe alone."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, NUMBERS)


STOPS = (signal.SIGTSTP, signal.SIGTTOU)
"""Signals by which a terminal stops a process: Ctrl-Z, and output of a background process."""


@contextmanager
def ignoring_terminal_stops() -> Iterator[None]:
    """Ignore the signals by which a terminal stops a process, until the block ends.

    For processes of nodes: a stopped driver watches nothing. Without effect off the main thread.
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
"""By ROS distribution: the variable that its Fast DDS reads."""

LOOPBACK = Path(__file__).parent / 'loopback.xml'
"""A Fast DDS profile: UDP on the loopback interface alone."""


def choose_transports(environment: Mapping[str, str], default_range: str) -> dict[str, str]:
    """Return the variables to set before ROS starts; what the user has chosen stays.

    ``default_range`` stands for ``ROS_AUTOMATIC_DISCOVERY_RANGE`` where it is not set.
    """
    if any(environment.get(name) for name in PROFILES):
        return {}  # a profile chooses transports and reach
    chosen_range = environment.get(RANGE) or default_range
    if chosen_range != 'LOCALHOST':
        return {} if environment.get(TRANSPORTS) else {TRANSPORTS: 'UDPv4'}
    variable = PROFILES_OF.get(environment.get('ROS_DISTRO', ''))
    if variable is None or 'fastrtps' not in environment.get('RMW_IMPLEMENTATION', ''):
        return {RANGE: chosen_range}  # nothing else surely reads the profile
    # In the range LOCALHOST, ROS adds shared memory itself. The profile confines as well.
    return {RANGE: 'SUBNET', variable: str(LOOPBACK)}
