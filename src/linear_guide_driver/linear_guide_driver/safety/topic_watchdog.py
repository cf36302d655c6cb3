# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tells whether a topic that motion depends on is still heard."""

from __future__ import annotations

import threading


class TopicWatchdog:
    """Liveliness of one topic on the monotonic clock; no IO, thread-safe.

    Parameters
    ----------
    topic : str
        Name of the topic, for sentences.
    timeout_s : float
        The topic counts as silent when nothing was heard for this long [s].
    """

    def __init__(self, topic: str, timeout_s: float) -> None:
        self._topic = topic
        self._timeout_ns = round(timeout_s * 1e9)
        self._lock = threading.Lock()
        self._heard_at_ns: int | None = None

    @property
    def was_heard(self) -> bool:
        """Whether anything was ever heard."""
        return self._heard_at_ns is not None

    def beat(self, now_ns: int) -> None:
        """Note a message at monotonic time ``now_ns`` [ns]."""
        with self._lock:
            self._heard_at_ns = now_ns

    def describe_silence(self, now_ns: int) -> str:
        """Return a sentence with the remedy while the topic is silent, else nothing [ns]."""
        with self._lock:
            if self._heard_at_ns is None:
                return f'Nothing has been heard on {self._topic} yet; start its node.'
            if now_ns - self._heard_at_ns <= self._timeout_ns:
                return ''
            return (
                f'Nothing was heard on {self._topic} for {self._timeout_ns / 1e9:g} s; '
                'look after its node.'
            )


def find_silence(watchdogs: tuple[TopicWatchdog, ...], now_ns: int) -> str:
    """Return the sentence of the first silent topic; empty when all are heard [ns]."""
    for watchdog in watchdogs:
        if silence := watchdog.describe_silence(now_ns):
            return silence
    return ''
