# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lets one motion through at a time and makes "a motion runs" and "stop it" one decision."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import threading

from linear_guide_driver.errors import MotionRefusedError, MotionStoppedError


class MotionGate:
    """Who moves the guide now, and whether somebody wants it stopped."""

    def __init__(self) -> None:
        self._slot = threading.Lock()  # held by the one motion
        self._lock = threading.Lock()
        self._motion = ''
        self._stop = threading.Event()

    @property
    def is_stopping(self) -> bool:
        """Whether the running motion is to stop."""
        return self._stop.is_set()

    @contextmanager
    def one_motion(self) -> Iterator[None]:
        """Keep every other motion out.

        Raises
        ------
        MotionRefusedError
            When one runs.
        """
        if not self._slot.acquire(blocking=False):
            raise MotionRefusedError('The guide is busy with another motion; stop it first.')
        try:
            yield
        finally:
            self.end()
            self._slot.release()

    def begin(self, motion: str, should_stop: Callable[[], bool]) -> None:
        """Let stops in from now on.

        Raises
        ------
        MotionStoppedError
            When one has come already: a stop does nothing before a motion has begun.
        """
        with self._lock:
            if should_stop():
                raise MotionStoppedError('Stopped before the guide moved.')
            self._stop.clear()
            self._motion = motion

    def end(self) -> bool:
        """Let no further stop in; return whether one has come."""
        with self._lock:
            self._motion = ''
            return self._stop.is_set()

    def request_stop(self, act: Callable[[str], None]) -> bool:
        """Ask the running motion to stop; return whether there is one.

        Parameters
        ----------
        act : callable
            Called with the motion's name while it cannot end: what is to happen at once.
        """
        with self._lock:
            if not self._motion:
                return False
            self._stop.set()
            act(self._motion)
            return True

    def unless_stopping(self, act: Callable[[], None]) -> None:
        """Do what continues the running motion, unless it is to stop.

        Parameters
        ----------
        act : callable
            Called while no stop can come in, so that a stop follows it and never precedes it.
        """
        with self._lock:
            if self._motion and not self._stop.is_set():
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
