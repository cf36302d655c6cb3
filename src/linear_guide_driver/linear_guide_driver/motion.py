# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One motion of a device at a time. Guide and tendon move by these rules; no IO.

A client builds a `Motion` from small functions that know its device, and `Motions.run` carries
it out:

===========  ====================================================================================
refused      while another motion runs, or by ``begin``: nothing has moved
begun        under a lock; a stop that has come already ends it before anything moves
waited for   ``begin`` returns a generator. It moves the device, yields what is new, and returns
             the result once the device is at rest on its target
stopped      by the caller's ``should_stop`` or by `Motions.request_stop`, until its very end:
             ``stop`` brings the device to rest
failed       by an error of device or line: ``fail`` notes it
abandoned    by an exception of the caller's functions: nobody watches the device any more, so
             ``abandon`` stops it
===========  ====================================================================================

Each way it ends with ``finish``. The caller gets the result, or a `MotionRefusedError`,
`MotionStoppedError` or `MotionFailedError`; those that a function of the motion raises pass.
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

News = TypeVar('News')
Result = TypeVar('Result')


@dataclass(frozen=True)
class Motion(Generic[News, Result]):
    """A device's part of one motion; see the table of this module.

    ``stop`` and ``fail`` return the sentence for the caller. ``brake`` is called by
    `Motions.request_stop` at once, before ``stop``.
    """

    begin: Callable[[], Generator[News | None, None, Result]]
    stop: Callable[[], str]
    fail: Callable[[str], str]
    abandon: Callable[[], object]
    finish: Callable[[], None]
    brake: Callable[[], None] = lambda: None


class Motions:
    """Runs the motions of one device; thread-safe.

    ``busy`` is the sentence of a refusal while another motion runs, ``not_begun`` that of a motion
    that was stopped before it began.
    """

    def __init__(self, busy: str, not_begun: str) -> None:
        self._busy, self._not_begun = busy, not_begun
        self._slot = threading.Lock()  # held by the one motion
        self._lock = threading.Lock()
        self._running: Motion[Any, Any] | None = None  # while a stop can come in
        self._should_stop: Callable[[], bool] = lambda: False
        self._stop = threading.Event()

    @property
    def is_stopping(self) -> bool:
        """True when the running motion is to stop."""
        return self._stop.is_set() or self._should_stop()

    def run(
        self,
        motion: Motion[News, Result],
        on_news: Callable[[News], None],
        should_stop: Callable[[], bool],
    ) -> Result:
        """Carry a motion out; return its result. ``on_news`` is called with what it yields.

        Raises
        ------
        MotionRefusedError, MotionStoppedError, MotionFailedError
            And the errors of ``begin``.
        """
        if not self._slot.acquire(blocking=False):
            raise MotionRefusedError(self._busy)
        try:
            news = motion.begin()
            self._let_stops_in(motion, should_stop)
            return self._carry_out(motion, news, on_news)
        finally:
            motion.finish()
            self._end()
            self._slot.release()

    def request_stop(self) -> bool:
        """Ask the running motion to stop; return whether there is one. It brakes at once."""
        with self._lock:
            if self._running is None:
                return False
            self._stop.set()
            self._running.brake()
            return True

    def unless_stopping(self, act: Callable[[], None]) -> None:
        """Do what continues the running motion, unless it is to stop.

        ``act`` is called while no stop can come in: a stop follows it and never precedes it.
        """
        with self._lock:
            if self._running is not None and not self._stop.is_set():
                act()

    @contextmanager
    def no_motion(self, timeout_s: float) -> Iterator[None]:
        """Wait until no motion runs, for so long at the most, and keep any from beginning [s]."""
        is_free = self._slot.acquire(timeout=timeout_s)
        try:
            yield
        finally:
            if is_free:
                self._slot.release()

    # -- inside --------------------------------------------------------------------------

    def _let_stops_in(self, motion: Motion[Any, Any], should_stop: Callable[[], bool]) -> None:
        with self._lock:
            if should_stop():
                raise MotionStoppedError(self._not_begun)
            self._stop.clear()
            self._running, self._should_stop = motion, should_stop

    def _carry_out(
        self,
        motion: Motion[News, Result],
        news: Generator[News | None, None, Result],
        on_news: Callable[[News], None],
    ) -> Result:
        try:
            with closing(news):
                result = self._wait(news, on_news)
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
        self, news: Generator[News | None, None, Result], on_news: Callable[[News], None]
    ) -> Result | None:
        """Return the result of the motion, or None as soon as it is to stop."""
        while True:
            try:
                new = next(news)
            except StopIteration as end:
                return None if self._end() else end.value
            if self.is_stopping:
                self._end()  # a further stop would brake the device after it was stopped
                return None
            if new is not None:
                on_news(new)

    def _end(self) -> bool:
        """Let no further stop in; return whether one has been requested."""
        with self._lock:
            self._running, self._should_stop = None, lambda: False
            return self._stop.is_set()
