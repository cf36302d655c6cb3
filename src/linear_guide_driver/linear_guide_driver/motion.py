# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Execution of the motions of a guide or tendon, one at a time; no IO.

A client defines a `Motion` by functions for its device, and `Motions.run` executes it. The table
shows the states of a motion, and the functions that are called:

===========  ====================================================================================
refused      another motion is running, or ``begin`` raises: nothing has moved
begun        under a lock; if a stop was requested before, the motion ends before it starts
running      ``begin`` has returned a generator, which moves the device, yields the progress, and
             returns the result once the device is at rest at its target
stopped      by the caller's ``should_stop`` or by `Motions.request_stop`, at any time until the
             end of the motion: ``stop`` brings the device to rest
failed       by an error of the device or the connection: ``fail`` handles it
abandoned    by an exception of the caller's functions: the device is no longer watched, so
             ``abandon`` stops it
===========  ====================================================================================

In every case ``finish`` is called last. The caller receives the result, or a `MotionRefusedError`,
`MotionStoppedError` or `MotionFailedError`. If a function of the motion raises one of these
errors, the caller receives it unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
import threading
from typing import Any, Generic, TypeVar

from linear_guide_driver.errors import (
    DeviceConnectionError,
    DeviceRefusedError,
    LinearGuideDriverError,
    MotionFailedError,
    MotionRefusedError,
    MotionStoppedError,
)

Progress = TypeVar('Progress')
Result = TypeVar('Result')


@dataclass(frozen=True)
class Motion(Generic[Progress, Result]):
    """Functions of one motion of a device; see the table of this module.

    ``stop`` and ``fail`` return the message for the caller. `Motions.request_stop` calls
    ``brake`` immediately, before ``stop``.
    """

    begin: Callable[[], Generator[Progress | None, None, Result]]
    stop: Callable[[], str]
    fail: Callable[[str], str]
    abandon: Callable[[], object]
    finish: Callable[[], None]
    brake: Callable[[], None] = lambda: None


class Motions:
    """Executes the motions of one device; thread-safe.

    Parameters
    ----------
    busy : str
        Message of the refusal while another motion is running.
    not_begun : str
        Message of a motion that was stopped before it began.
    """

    def __init__(self, busy: str, not_begun: str) -> None:
        self._busy, self._not_begun = busy, not_begun
        self._slot = threading.Lock()  # locked while a motion runs
        self._lock = threading.Lock()
        self._running: Motion[Any, Any] | None = None  # set while the motion can be stopped
        self._should_stop: Callable[[], bool] = lambda: False
        self._stop = threading.Event()

    @property
    def is_stopping(self) -> bool:
        """True if a stop of the running motion has been requested."""
        return self._stop.is_set() or self._should_stop()

    def run(
        self,
        motion: Motion[Progress, Result],
        on_progress: Callable[[Progress], None],
        should_stop: Callable[[], bool],
    ) -> Result:
        """Execute a motion and return its result.

        Parameters
        ----------
        motion : Motion
            The motion.
        on_progress : callable
            Called with each value that the motion yields, except None.
        should_stop : callable
            Returns True if the motion must stop.

        Raises
        ------
        MotionRefusedError, MotionStoppedError, MotionFailedError
            See the table of this module; also the errors of ``motion.begin``.
        """
        if not self._slot.acquire(blocking=False):
            raise MotionRefusedError(self._busy)
        try:
            progress = motion.begin()
            self._allow_stops(motion, should_stop)
            return self._carry_out(motion, progress, on_progress)
        finally:
            motion.finish()
            self._end()
            self._slot.release()

    def request_stop(self) -> bool:
        """Brake and stop the running motion; return True if there is one."""
        with self._lock:
            if self._running is None:
                return False
            self._stop.set()
            self._running.brake()
            return True

    def unless_stopping(self, act: Callable[[], None]) -> None:
        """Call ``act``, which continues the running motion, unless a stop has been requested.

        A stop that is requested at the same time is executed after ``act``, never before it.
        """
        with self._lock:
            if self._running is not None and not self._stop.is_set():
                act()

    @contextmanager
    def no_motion(self, timeout_s: float) -> Iterator[None]:
        """Wait up to ``timeout_s`` [s] for the end of the motion, and then block new motions."""
        is_free = self._slot.acquire(timeout=timeout_s)
        try:
            yield
        finally:
            if is_free:
                self._slot.release()

    # -- inside --------------------------------------------------------------------------

    def _allow_stops(self, motion: Motion[Any, Any], should_stop: Callable[[], bool]) -> None:
        with self._lock:
            if should_stop():
                raise MotionStoppedError(self._not_begun)
            self._stop.clear()
            self._running, self._should_stop = motion, should_stop

    def _carry_out(
        self,
        motion: Motion[Progress, Result],
        progress: Generator[Progress | None, None, Result],
        on_progress: Callable[[Progress], None],
    ) -> Result:
        try:
            with closing(progress):
                result = self._wait(progress, on_progress)
            if result is None:
                raise MotionStoppedError(motion.stop())
            return result
        except (DeviceConnectionError, DeviceRefusedError) as error:
            raise MotionFailedError(motion.fail(str(error))) from error
        except LinearGuideDriverError:
            raise
        except BaseException:
            motion.abandon()
            raise

    def _wait(
        self,
        progress: Generator[Progress | None, None, Result],
        on_progress: Callable[[Progress], None],
    ) -> Result | None:
        """Return the result of the motion, or None once it must stop."""
        while True:
            try:
                new = next(progress)
            except StopIteration as end:
                return None if self._end() else end.value
            if self.is_stopping:
                self._end()  # a second stop must not brake a device that is at rest
                return None
            if new is not None:
                on_progress(new)

    def _end(self) -> bool:
        """Accept no further stop of this motion; return True if a stop was requested."""
        with self._lock:
            self._running, self._should_stop = None, lambda: False
            return self._stop.is_set()
