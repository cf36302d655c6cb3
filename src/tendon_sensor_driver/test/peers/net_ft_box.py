# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated ATI Net F/T without its sockets: settings, sample counter, records, faults."""

from __future__ import annotations

from collections.abc import Callable
from urllib.parse import parse_qs, urlsplit

import numpy as np
from numpy.typing import NDArray

from tendon_sensor_driver.net_ft_protocol import (
    Command,
    CONFIGURATION_PAGE,
    ERROR_SUMMARY,
    INTERNAL_RATE_HZ,
    MOST_RECORDS,
    RECORD,
    SATURATED,
)
from tendon_sensor_driver.records import AXES, NEWTONS

Force = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Axial force [N] at times since power-up [s], both of shape (samples,)."""

_STORED = {'comrdtrate': 1000, 'comrdtbsiz': 10, 'comrdte': 1, 'setuserfilter': 0}
_RANGES = {
    'comrdtrate': (1, INTERNAL_RATE_HZ),
    'comrdtbsiz': (1, MOST_RECORDS),
    'comrdte': (0, 1),
    'setuserfilter': (0, 12),
}
_SATURATED_N = 1000.0
_UPTIME_S = 150.0  # at the beginning: a restart is seen by a counter that falls back


class NetFtBox:
    """Answers and packets of a Net F/T.

    Its settings fall back to stored ones at a restart; its low pass is remembered, not
    computed. Simulated: how a real box behaves beyond the documented protocol is not known.

    Parameters
    ----------
    force : callable or ndarray
        Axial force [N]: a function of time, or samples at 7000 Hz that are repeated.
    axis : str
        Component that carries it.
    counts_per_force : int
        Of the calibration.
    force_unit : str
        ``N`` or ``lbf``: in what the box counts.
    noise_counts : float
        Standard deviation of every component.
    serial : str
        Of the calibration.
    """

    def __init__(
        self,
        force: Force | NDArray[np.float64],
        *,
        axis: str = 'fz',
        counts_per_force: int = 1_000_000,
        force_unit: str = 'N',
        noise_counts: float = 500.0,
        serial: str = 'FT00000',
    ) -> None:
        self._force = _repeat(force) if isinstance(force, np.ndarray) else force
        self._axis = AXES.index(axis)
        self._counts_per_newton = counts_per_force / NEWTONS[force_unit]
        self._noise_counts = noise_counts
        self._generator = np.random.default_rng(0)
        self._identity = {
            'prodname': 'ATI Net F/T (simulated)',
            'cfgcalsn': serial,
            'cfgcpf': counts_per_force,
            'cfgcpt': 1_000_000,
            'scfgfu': force_unit,
            'scfgtu': 'Nm',
        }
        self.settings = dict(_STORED)
        self._begun_s = -_UPTIME_S
        self._faults: dict[str, tuple[float, dict[str, float]]] = {}
        self._command = Command.STOP
        self._record = 0
        self._ticks = self._shown = 0  # of the newest record, and what it says
        self._status = 0
        self._held: list[NDArray[np.void]] = []  # records that wait for their datagram
        self._overtaken: list[bytes] = []
        self._delayed: list[bytes] = []  # on their way through a slow network

    # -- faults ------------------------------------------------------------------------

    def fault(
        self, kind: str, now_s: float, duration_s: float | None = None, **options: float
    ) -> None:
        """Begin a fault; without a duration it lasts until `heal`.

        Kinds: burst, mute, restart, saturate, stale, status, stuck, unplug; and drop, duplicate,
        reorder and garbage with the ``fraction`` of the datagrams (default 0.1).
        """
        if kind == 'restart':
            duration_s = 0.5 if duration_s is None else duration_s
            self._begun_s = now_s + duration_s
            self.settings = dict(_STORED)
            self._stop()
            self._delayed.clear()
        self._faults[kind] = (now_s + (np.inf if duration_s is None else duration_s), options)

    def heal(self) -> None:
        """End all faults."""
        self._faults.clear()

    def has(self, kind: str, now_s: float) -> bool:
        """True while a fault is on."""
        return kind in self._faults and now_s < self._faults[kind][0]

    def is_away(self, now_s: float) -> bool:
        """True while nothing at all is answered."""
        return self.has('unplug', now_s) or self.has('restart', now_s)

    # -- web pages ---------------------------------------------------------------------

    def answer(self, path: str) -> bytes | None:
        """Return the page, or None where there is none; a query changes settings."""
        parts = urlsplit(path)
        if parts.path == CONFIGURATION_PAGE:
            return self._describe()
        if parts.path not in ('/comm.cgi', '/setting.cgi'):
            return None
        for name, values in parse_qs(parts.query).items():
            low, high = _RANGES.get(name, (0, -1))
            if values[-1].isdecimal() and low <= int(values[-1]) <= high:
                self.settings[name] = int(values[-1])
        return b'<html><body>Settings</body></html>'

    def _describe(self) -> bytes:
        tags: dict[str, object] = {
            **self._identity,
            'runstat': f'0x{self._status:08x}',
            'runrate': INTERNAL_RATE_HZ,
            'setuserfilter': self.settings['setuserfilter'],
            'comrdte': 'Enabled' if self.settings['comrdte'] else 'Disabled',
            # Whole numbers, as a box of firmware 2.2.59 reports them.
            'comrdtrate': INTERNAL_RATE_HZ // self._divisor,
            'comrdtbsiz': self.settings['comrdtbsiz'],
        }
        body = ''.join(f'<{name}>{value}</{name}>' for name, value in tags.items())
        return f'<?xml version="1.0"?><netft>{body}</netft>'.encode()

    # -- records -----------------------------------------------------------------------

    @property
    def _divisor(self) -> int:
        return INTERNAL_RATE_HZ // self.settings['comrdtrate']

    def command(self, command: Command, now_s: float) -> None:
        """Take a request."""
        if self.is_away(now_s) or not self.settings['comrdte']:
            return
        if command in (Command.START_REALTIME, Command.START_BUFFERED):
            self._stop()
            self._command = command
            self._ticks = self._count(now_s)
        elif command is Command.STOP:
            self._stop()

    def _stop(self) -> None:
        self._command = Command.STOP
        self._record = 0
        self._held.clear()

    def _count(self, now_s: float) -> int:
        return max(0, int((now_s - self._begun_s) * INTERNAL_RATE_HZ))

    def poll(self, now_s: float) -> list[bytes]:
        """Return the datagrams that are due."""
        if self._command is Command.STOP or self.is_away(now_s):
            return []
        divisor = self._divisor
        first = (self._ticks // divisor + 1) * divisor
        ticks = np.arange(first, self._count(now_s) + 1, divisor)
        if not len(ticks):
            return []
        self._ticks = int(ticks[-1])
        datagrams = self._pack(self._measure(ticks, now_s))
        if self.has('mute', now_s):
            return []
        if self.has('burst', now_s):
            self._delayed += datagrams
            return []
        delayed, self._delayed = self._delayed, []
        return self._spoil(delayed + datagrams, now_s)

    def _measure(self, ticks: NDArray[np.int64], now_s: float) -> NDArray[np.void]:
        records = np.zeros(len(ticks), dtype=RECORD)
        records['rdt_sequence'] = (self._record + 1 + np.arange(len(ticks))) & 0xFFFFFFFF
        self._record += len(ticks)
        shown = np.full_like(ticks, self._shown) if self.has('stale', now_s) else ticks
        self._shown = int(shown[-1])
        records['ft_sequence'] = shown & 0xFFFFFFFF
        counts = self._noise_counts * self._generator.standard_normal((len(ticks), 6))
        force_n = self._force(ticks / INTERNAL_RATE_HZ)
        self._status = 0
        if self.has('saturate', now_s):
            force_n = np.full(len(ticks), _SATURATED_N)
            self._status = ERROR_SUMMARY | SATURATED
        if self.has('status', now_s):
            self._status |= ERROR_SUMMARY | 1 << 6
        records['status'] = self._status
        counts[:, self._axis] += force_n * self._counts_per_newton
        if self.has('stuck', now_s):
            counts[:] = 1_000_000
        records['counts'] = np.rint(np.clip(counts, -(2**31), 2**31 - 1))
        return records

    def _pack(self, records: NDArray[np.void]) -> list[bytes]:
        if self._command is Command.START_REALTIME:
            return [records[i : i + 1].astype(RECORD).tobytes() for i in range(len(records))]
        self._held.append(records)
        waiting = np.concatenate(self._held)
        size = self.settings['comrdtbsiz']
        whole = len(waiting) // size * size
        self._held = [waiting[whole:]]
        return [waiting[i : i + size].astype(RECORD).tobytes() for i in range(0, whole, size)]

    def _spoil(self, datagrams: list[bytes], now_s: float) -> list[bytes]:
        sent: list[bytes] = []
        for datagram in datagrams:
            if self._happens('drop', now_s):
                continue
            if self._happens('garbage', now_s):
                sent.append(self._generator.bytes(17))
                continue
            if not self._overtaken and self._happens('reorder', now_s):
                self._overtaken = [datagram]
                continue
            sent.append(datagram)
            if self._happens('duplicate', now_s):
                sent.append(datagram)
            sent += self._overtaken
            self._overtaken = []
        return sent

    def _happens(self, kind: str, now_s: float) -> bool:
        if not self.has(kind, now_s):
            return False
        return bool(self._generator.random() < self._faults[kind][1].get('fraction', 0.1))


def _repeat(samples_n: NDArray[np.float64]) -> Force:
    def force(times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        indices = np.rint(times_s * INTERNAL_RATE_HZ).astype(np.int64) % len(samples_n)
        repeated: NDArray[np.float64] = samples_n[indices]
        return repeated

    return force
