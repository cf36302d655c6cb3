# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The stopped state of a rig, of which each node keeps a copy.

Both drivers and the trial runner have a `StopLatch`. They exchange its `StopState` on one topic,
and the highest state is valid. Every stop and every reset increments the number of the state.
Therefore a stop wins against a simultaneous reset, the copies become equal regardless of the
order in which states arrive, and a restarted node receives the present state from the others.

An `EmergencyInput` is a topic on which false must be published periodically. The value true and
silence stop the rig. Only `StopLatch.reset` ends the stopped state.

No IO and no clock; thread-safe. Times are monotonic [ns].
"""

from __future__ import annotations

from collections.abc import Callable
import threading
from typing import NamedTuple

from linear_guide_driver.errors import capitalise
from tactile_ros.refusal import Refusal

__all__ = ['EmergencyInput', 'StopLatch', 'StopState']

RESET = 'remove the cause, then call the service reset of a node of the rig, or use the live page'


class StopState(NamedTuple):
    """Stopped state of a rig; mirrors ``tactile_msgs/StopState``.

    States are ordered as tuples, and the highest one is valid.
    """

    number: int = 0  # incremented by each stop and each reset
    is_stopped: bool = False
    reason: str = ''  # clause that names the cause of the stop; an empty string if not stopped

    @property
    def refusal(self) -> Refusal | None:
        """Why motion is not allowed; None if the rig is not stopped."""
        return Refusal(f'The rig is stopped: {self.reason}', RESET) if self.is_stopped else None


class EmergencyInput:
    """An emergency stop on a topic: true means stop, false means that motion is allowed.

    If no message arrives for ``timeout_s`` [s], the input is lost, which counts as a stop.
    """

    def __init__(self, topic: str, timeout_s: float) -> None:
        self._topic = topic
        self._timeout_ns = round(timeout_s * 1e9)
        self._last: tuple[int, bool] | None = None  # arrival [ns] and value of the last message

    @property
    def was_heard(self) -> bool:
        """True once a message has arrived."""
        return self._last is not None

    def hear(self, is_stop: bool, now_ns: int) -> None:
        """Record a message that arrived at ``now_ns`` [ns]."""
        self._last = now_ns, is_stop

    def find_stop(self, now_ns: int) -> Refusal | None:
        """Return why the rig must stop, or None. Return None before the first message, too."""
        if self._last is None:
            return None
        remedy = 'release the emergency stop, check its publisher, then reset the rig'
        heard_at_ns, is_stop = self._last
        if is_stop:
            return Refusal(f'the emergency stop on {self._topic} is pressed', remedy)
        if now_ns - heard_at_ns > self._timeout_ns:
            silence_s = self._timeout_ns / 1e9
            return Refusal(
                f'no message has arrived from the emergency stop on {self._topic} for '
                f'{silence_s:g} s',
                remedy,
            )
        return None

    def find_refusal(self, now_ns: int) -> Refusal | None:
        """Return why neither motion nor a reset is allowed, or None."""
        if not self.was_heard:
            reason = f'No message has arrived from the emergency stop on {self._topic} yet'
            return Refusal(reason, 'start its publisher')
        stop = self.find_stop(now_ns)
        return None if stop is None else Refusal(capitalise(stop.reason), stop.remedy)


class StopLatch:
    """One node's copy of the stopped state; a `linear_guide_driver.safety.Watch`.

    `join` connects the node to the others, and `leave` disconnects it. The latch keeps its state
    meanwhile: a stopped node is still stopped after it has been configured again.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._lapse: Refusal | None = None  # an emergency stop that `find_loss` has detected
        self.state = StopState()
        self.emergency: EmergencyInput | None = None
        self.leave()

    def join(self, on_change: Callable[[], None], count_publishers: Callable[[], int]) -> None:
        """Connect to the other nodes.

        Parameters
        ----------
        on_change : callable
            Publishes ``state`` and stops the device. Called after each change of ``state``, on
            the thread that made the change, and without a lock. `find_loss` never calls it, so
            `find_loss` may be called under any lock.
        count_publishers : callable
            Returns the number of nodes whose states can be received, this one included.
        """
        self._senders: set[str] = set()
        self._on_change, self._count_publishers = on_change, count_publishers

    def leave(self) -> None:
        """Disconnect from the other nodes, and keep the state."""
        self.join(lambda: None, lambda: 0)

    # -- changes ---------------------------------------------------------------------------

    def stop(self, reason: str) -> None:
        """Stop the rig. ``reason`` is a clause; a stopped rig keeps its first reason."""
        with self._lock:
            number, is_stopped, first = self.state
            self.state = StopState(number + 1, True, first if is_stopped else reason)
        self._on_change()

    def reset(self, now_ns: int) -> Refusal | None:
        """End the stopped state; return why this is refused at ``now_ns`` [ns], or None."""
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
        """Take over the state of a node if it is higher.

        ``sender`` identifies the node and must be unique to each start of a node.
        """
        with self._lock:
            self._senders.add(sender)
            if state <= self.state:
                return
            self.state = state
        self._on_change()

    def hear_emergency(self, is_stop: bool, now_ns: int) -> None:
        """Record a message of the emergency stop that arrived at ``now_ns`` [ns]."""
        if self.emergency is not None:
            self.emergency.hear(is_stop, now_ns)
            self.check(now_ns)

    def check(self, now_ns: int) -> None:
        """Set the latch if the emergency stop is pressed or lost; call this periodically."""
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
        """Return why motion is not allowed at ``now_ns`` [ns], or None."""
        if refusal := self.state.refusal:
            return refusal
        if lapse := self._find_lapse(now_ns):
            self._lapse = lapse  # `check` sets the latch, even if the input has recovered by then
            return Refusal(f'The rig is stopped: {lapse.reason}', RESET)
        return None if self.emergency is None else self.emergency.find_refusal(now_ns)

    def _find_lapse(self, now_ns: int) -> Refusal | None:
        return self._lapse or (self.emergency.find_stop(now_ns) if self.emergency else None)
