# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Something that must be heard from regularly while anything moves."""

from __future__ import annotations

import threading


class Heartbeat:
    """Tells whether the last sign of life is recent; no IO, no clock, thread-safe.

    Parameters
    ----------
    what : str
        For sentences: "a heart beat on trial_runner/heartbeat".
    timeout_s : float
        Older signs of life count as none [s].
    """

    def __init__(self, what: str, timeout_s: float) -> None:
        self._what = what
        self._timeout_ns = round(timeout_s * 1e9)
        self._lock = threading.Lock()
        self._heard_at_ns: int | None = None
        self._was_alive = False

    def beat(self, now_ns: int) -> None:
        """Note a sign of life at monotonic time ``now_ns`` [ns]."""
        with self._lock:
            self._heard_at_ns = now_ns
            self._was_alive = True

    def describe_silence(self, now_ns: int) -> str:
        """Return a sentence about what is missing; empty when nothing is [ns]."""
        with self._lock:
            return '' if self._is_alive(now_ns) else self._sentence

    def take_loss(self, now_ns: int) -> str:
        """Return the sentence once when it falls silent, and nothing otherwise [ns]."""
        with self._lock:
            if not self._was_alive or self._is_alive(now_ns):
                return ''
            self._was_alive = False
            return self._sentence

    @property
    def _sentence(self) -> str:
        return f'Nothing was heard of {self._what} for {self._timeout_ns / 1e9:g} s.'

    def _is_alive(self, now_ns: int) -> bool:
        return self._heard_at_ns is not None and now_ns - self._heard_at_ns <= self._timeout_ns
