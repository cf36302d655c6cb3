# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""State that all pages show: fingers, devices, progress and log. Without ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
import threading
import time
from typing import Any

from tactile_classifier.types import WindowPrediction
from tactile_lab.watch.finger import Finger, format_answer

MOST_FINGERS = 16
MOST_DEVICES = 64
MOST_SENTENCES = 30
STALE_S = 5.0
"""A device is shown as silent if it has published no diagnostics for this time [s]."""

SPECTRUM_PERIOD_S = 0.2
"""Shortest time between two spectra of a finger [s]."""

LEVELS = ('ok', 'warning', 'error', 'stale')
"""Names of the levels of a DiagnosticStatus; the index is the level."""


class WatchState:
    """The current state. Any thread may change it; one thread reads it with `Frames`.

    Attributes
    ----------
    on_answer : callable
        Called with one line about every prediction on a full window.
    was_stopped : bool
        True if Stop was pressed on a page.
    """

    def __init__(
        self,
        where: str = '',
        objects: Mapping[str, Sequence[str]] | None = None,
        clock: Callable[[], float] = time.monotonic,
        *,
        simulated: bool = False,
    ) -> None:
        """Create a state without fingers.

        Parameters
        ----------
        where : str
            Where fingers are searched, such as ``ROS domain 3``. It is shown until one is found.
        objects : mapping
            For each protocol, labels that the page proposes for a trial.
        clock : callable
            Returns monotonic time [s].
        """
        self._lock = threading.RLock()
        self._clock = clock
        self._where = where
        self._simulated = simulated
        self._objects = {k: list(v) for k, v in (objects or {}).items()}
        self._fingers: dict[str, Finger] = {}
        self._controls: dict[str, tuple[str, ...]] = {}
        self._devices: dict[str, tuple[float, dict[str, Any]]] = {}
        self._missing: dict[str, tuple[str, ...]] = {}
        self._stops: dict[str, str] = {}  # reason why the rig in a namespace is stopped
        self._can_release = False
        self._sentences: deque[dict[str, Any]] = deque(maxlen=MOST_SENTENCES)
        self._progress = ''
        self._version = 0
        self.was_stopped = False
        self.on_answer: Callable[[str], None] = lambda _: None

    # -- input -----------------------------------------------------------------------

    def finger(self, name: str) -> Finger | None:
        """Return the finger in a namespace; create it if it does not exist.

        Return None if there are already `MOST_FINGERS` other fingers.
        """
        with self._lock:
            if name not in self._fingers and len(self._fingers) < MOST_FINGERS:
                self._fingers[name] = Finger(name)
                self._version += 1
            return self._fingers.get(name)

    def update(self, name: str, take: Callable[..., object], *values: Any) -> None:
        """Call ``take``, a method of `Finger`, for the finger ``name`` with ``values``."""
        with self._lock:
            if finger := self.finger(name):
                take(finger, *values)

    def take_answer(self, name: str, answer: WindowPrediction) -> None:
        """Add the prediction of a model."""
        with self._lock:
            finger = self.finger(name)
            if finger is None:
                return
            true_label = finger.take_answer(answer)
            line = format_answer(name, answer, true_label, names_model=finger.names_model(answer))
            self.say(line, finger=name)
        self.on_answer(line)

    def take_health(
        self, device: str, level: int, message: str, values: Mapping[str, str]
    ) -> None:
        """Set the health of a device or node from its diagnostics."""
        with self._lock:
            if device not in self._devices and len(self._devices) >= MOST_DEVICES:
                return
            name = LEVELS[level] if 0 <= level < len(LEVELS) else 'error'
            health = {'level': name, 'message': message}
            if self._devices.get(device, (0.0, {}))[1] != health:
                self._version += 1
            self._devices[device] = (self._clock(), health)
            if 'trials' in values:  # diagnostics of an operator node
                self._progress = message

    def take_readiness(self, device: str, missing: Sequence[str]) -> None:
        """Set the reasons why a device accepts no goal, each with its remedy."""
        with self._lock:
            if device in self._missing or len(self._missing) < MOST_DEVICES:
                self._missing[device] = tuple(missing)
                self._version += 1

    def take_stop(self, namespace: str, reason: str) -> None:
        """Set the stopped state of the rig in a namespace.

        If ``reason`` is empty, the rig is not stopped. The numbers in the messages are ignored,
        because a restarted rig counts from 0 again.
        """
        with self._lock:
            if reason != self._stops.get(namespace, '') and len(self._stops) < MOST_DEVICES:
                self._version += 1
                self._stops[namespace] = reason

    def set_can_release(self, can_release: bool) -> None:
        """Set whether there is a tendon actuator that can slacken its tendon."""
        with self._lock:
            if can_release != self._can_release:
                self._can_release = can_release
                self._version += 1

    def set_controls(self, name: str, controls: Sequence[str]) -> None:
        """Set the available actions of a finger: ``stop``, ``tare``, ``home``, ``trial``."""
        with self._lock:
            if self._controls.get(name) != tuple(controls):
                self._controls[name] = tuple(controls)
                self._version += 1

    def say(
        self, text: str, level: str = 'ok', command_id: str = '', finger: str | None = None
    ) -> None:
        """Add a message to the log that every page shows.

        ``command_id`` is the id of the command whose result the message states. ``finger`` is the
        finger that the message is about, or None if it is about all fingers.
        """
        with self._lock:
            sentence = {'at': time.time(), 'level': level, 'text': text, 'id': command_id}
            self._sentences.append({**sentence, 'finger': finger})
            self._version += 1

    # -- output -------------------------------------------------------------------------

    @property
    def fingers(self) -> list[Finger]:
        """The fingers, sorted by name."""
        with self._lock:
            return [self._fingers[name] for name in sorted(self._fingers)]

    def describe(self) -> dict[str, Any]:
        """Return the state, except samples and spectra, as a dictionary for JSON."""
        with self._lock:
            return {
                'where': self._where,
                'simulated': self._simulated or any(f.simulated for f in self.fingers),
                'objects': self._objects,
                'fingers': [
                    {**finger.describe(), 'can': list(self._controls.get(finger.name, ()))}
                    for finger in self.fingers
                ],
                'devices': self._describe_devices(),
                'progress': self._progress,
                'can_release': self._can_release,
                'stopped': [
                    {'finger': namespace, 'reason': reason}
                    for namespace, reason in sorted(self._stops.items())
                    if reason
                ],
                'said': list(self._sentences),
            }

    def _describe_devices(self) -> list[dict[str, Any]]:
        """Return the health of all devices, sorted by name, for JSON."""
        now_s = self._clock()
        rows = []
        for name, (at_s, health) in sorted(self._devices.items()):
            row = {'name': name, **health, 'missing': list(self._missing.get(name, ()))}
            if now_s - at_s > STALE_S:
                row['level'] = 'stale'
                row['message'] = 'silent; start its node again'
            rows.append(row)
        return rows

    def _versions(self) -> tuple[Any, ...]:
        now_s = self._clock()
        stale = sum(now_s - at_s > STALE_S for at_s, _ in self._devices.values())
        return self._version, stale, *(f.version for f in self.fingers)


class Frames:
    """Creates the frames that are sent to pages.

    The first frame after `restart` is complete. Each further frame contains only the new points of
    each finger, and other parts that have changed.
    """

    def __init__(self, state: WatchState) -> None:
        self._state = state
        self.restart()

    def restart(self) -> None:
        """Make the next frame complete."""
        self._known: dict[str, tuple[int, int]] = {}
        self._versions: tuple[Any, ...] | None = None
        self._spectra_s: dict[str, float] = {}

    def next(self) -> dict[str, Any] | None:
        """Return the next frame as a dictionary for JSON; None if nothing is new."""
        state = self._state
        with state._lock:  # noqa: SLF001 - both belong to the state
            now_s = state._clock()  # noqa: SLF001
            frame: dict[str, Any] = {}
            versions = state._versions()  # noqa: SLF001
            if versions != self._versions:
                self._versions = versions
                frame['state'] = state.describe()
            live = {}
            for finger in state.fingers:
                epoch, count = known = self._known.get(finger.name, (-1, 0))
                if known == (finger.epoch, finger.point_count):
                    continue
                self._known[finger.name] = (finger.epoch, finger.point_count)
                times_s, tensions_n = finger.points_since(count if epoch == finger.epoch else 0)
                live[finger.name] = {'epoch': finger.epoch, 'x': times_s, 'y': tensions_n}
                if now_s - self._spectra_s.get(finger.name, -1.0) >= SPECTRUM_PERIOD_S:
                    self._spectra_s[finger.name] = now_s
                    live[finger.name] |= finger.detail()
            if live:
                frame['live'] = live
            return frame or None
