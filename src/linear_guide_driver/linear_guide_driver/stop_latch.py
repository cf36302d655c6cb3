# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The latch of Stop: one stopped state of the rig, of which each node keeps a copy.

Both drivers and the trial runner have a `StopLatch`. They exchange its `StopState` on one topic,
and the highest state counts. Every stop and every reset raises the number by one. A stop that
comes at the same time as a reset therefore wins, the copies become equal in whatever order the
states arrive, and a node that has started again gets the present state from the others.

An `EmergencyInput` is a topic that must keep saying that all is well. It latches when it says
stop and when it falls silent. Only `StopLatch.reset` ends the stopped state.

No IO and no clock; thread-safe. Times are monotonic [ns].
"""

from __future__ import annotations

from collections.abc import Callable
import threading
from typing import NamedTuple

from linear_guide_driver.errors import capitalise
from tactile_ros.refusal import Refusal

__all__ = ['EmergencyInput', 'StopLatch', 'StopState']

RESET = 'remove the cause, then call the service reset of one of its nodes, or use the live page'


class StopState(NamedTuple):
    """The stopped state of a rig. States are ordered: the highest one counts.

    ``number`` rises with each stop and each reset. ``reason`` is a clause that names the cause of
    the stop; it is empty when the rig is not stopped.
    """

    number: int = 0
    is_stopped: bool = False
    reason: str = ''

    @property
    def refusal(self) -> Refusal | None:
        """Why nothing may move; None when the rig is not stopped."""
        return Refusal(f'The rig is stopped: {self.reason}', RESET) if self.is_stopped else None


class EmergencyInput:
    """An emergency stop on a topic: true is stop, false says that all is well.

    Without a message for ``timeout_s`` [s] the input is lost, which counts as a stop.
    """

    def __init__(self, topic: str, timeout_s: float) -> None:
        self._topic = topic
        self._timeout_ns = round(timeout_s * 1e9)
        self._last: tuple[int, bool] | None = None  # arrival [ns] and value of the last message

    @property
    def was_heard(self) -> bool:
        """True once a message has come."""
        return self._last is not None

    def hear(self, is_stop: bool, now_ns: int) -> None:
        """Take a message."""
        self._last = now_ns, is_stop

    def find_stop(self, now_ns: int) -> Refusal | None:
        """Return why the rig must stop, or None while all is well or nothing has come."""
        if self._last is None:
            return None
        remedy = 'release it, check its publisher, then reset'
        heard_at_ns, is_stop = self._last
        if is_stop:
            return Refusal(f'the emergency stop on {self._topic} is pressed', remedy)
        if now_ns - heard_at_ns > self._timeout_ns:
            silence_s = self._timeout_ns / 1e9
            reason = f'the emergency stop on {self._topic} was not heard for {silence_s:g} s'
            return Refusal(reason, remedy)
        return None

    def find_refusal(self, now_ns: int) -> Refusal | None:
        """Return why nothing may move and no reset is possible; None while all is well."""
        if not self.was_heard:
            reason = f'The emergency stop on {self._topic} has not been heard yet'
            return Refusal(reason, 'start its publisher')
        stop = self.find_stop(now_ns)
        return None if stop is None else Refusal(capitalise(stop.reason), stop.remedy)


class StopLatch:
    """One node's copy of the stopped state; a `linear_guide_driver.safety.Watch`.

    The latch outlives the connection of its node to the others, which is made by `join`: a node
    that is configured again is still stopped.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._lapse: Refusal | None = (
            None  # a stop of the emergency input that `find_loss` has seen
        )
        self.state = StopState()
        self.emergency: EmergencyInput | None = None
        self.leave()

    def join(self, on_change: Callable[[], None], count_publishers: Callable[[], int]) -> None:
        """Connect to the other nodes.

        Parameters
        ----------
        on_change : callable
            Called after each change, to publish ``state`` and to stop the device, on the thread
            that made the change and without a lock. `find_loss` never calls it, and may
            therefore be called under any lock.
        count_publishers : callable
            Returns the number of nodes whose states can be received, this one included.
        """
        self._senders: set[str] = set()
        self._on_change, self._count_publishers = on_change, count_publishers

    def leave(self) -> None:
        """Keep the state, and exchange no more."""
        self.join(lambda: None, lambda: 0)

    # -- changes ---------------------------------------------------------------------------

    def stop(self, reason: str) -> None:
        """Stop the rig for a reason, a clause. A rig that is stopped keeps its first reason."""
        with self._lock:
            number, is_stopped, first = self.state
            self.state = StopState(number + 1, True, first if is_stopped else reason)
        self._on_change()

    def reset(self, now_ns: int) -> Refusal | None:
        """End the stopped state; return None, or why that is refused [ns]."""
        self.check(now_ns)
        if self.emergency is not None and (refusal := self.emergency.find_refusal(now_ns)):
            return refusal
        with self._lock:
            if not self.state.is_stopped:
                return None
            self.state = StopState(self.state.number + 1)
        self._on_change()
        return None

    def take(self, state: StopState, sender: str) -> None:
        """Take the state of a node, named by a string that no other run of a node uses."""
        with self._lock:
            self._senders.add(sender)
            if state <= self.state:
                return
            self.state = state
        self._on_change()

    def hear_emergency(self, is_stop: bool, now_ns: int) -> None:
        """Take a message of the emergency stop [ns]."""
        if self.emergency is not None:
            self.emergency.hear(is_stop, now_ns)
            self.check(now_ns)

    def check(self, now_ns: int) -> None:
        """Latch when the emergency stop says stop, or is lost. Call it periodically [ns]."""
        if lapse := self._find_lapse(now_ns):
            self._lapse = None
            if not self.state.is_stopped:
                self.stop(lapse.reason)

    # -- a watch -----------------------------------------------------------------------------

    @property
    def was_heard(self) -> bool:
        """True once the emergency stop and the state of each node have been heard."""
        is_known = self.emergency is None or self.emergency.was_heard
        return is_known and len(self._senders) >= self._count_publishers()

    def find_loss(self, now_ns: int) -> Refusal | None:
        """Return why nothing may move; None when it may [ns]."""
        if refusal := self.state.refusal:
            return refusal
        if lapse := self._find_lapse(now_ns):
            self._lapse = lapse  # `check` latches it, even if the input is heard again by then
            return Refusal(f'The rig is stopped: {lapse.reason}', RESET)
        return None if self.emergency is None else self.emergency.find_refusal(now_ns)

    def _find_lapse(self, now_ns: int) -> Refusal | None:
        return self._lapse or (self.emergency.find_stop(now_ns) if self.emergency else None)
