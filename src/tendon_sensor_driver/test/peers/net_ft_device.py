# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated ATI Net F/T, which sends records over UDP and has settings on web pages.

It follows the documented protocol. Other behaviour of the real device is not known.
"""

import contextlib
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
import select
import socket
import struct
import threading
import time
from urllib.parse import parse_qs, urlsplit

import numpy as np

from tendon_sensor_driver.config import AXES, NEWTONS
from tendon_sensor_driver.net_ft_protocol import (
    Command,
    CONFIGURATION_PAGE,
    ERROR_SUMMARY,
    INTERNAL_RATE_HZ,
    MOST_RECORDS,
    RECORD,
    SATURATED,
)

HOST = '127.0.0.1'
_STORED = {'comrdtrate': 1000, 'comrdtbsiz': 10, 'comrdte': 1, 'setuserfilter': 0}
_RANGES = {
    'comrdtrate': (1, INTERNAL_RATE_HZ),
    'comrdtbsiz': (1, MOST_RECORDS),
    'comrdte': (0, 1),
    'setuserfilter': (0, 12),
}
_SATURATED_N = 1000.0
_UPTIME_S = 150.0  # time since power-up at the start, so that a restart sets the counter back
_SLICE_S = 0.001


class NetFtBox:
    """Computes the answers and packets of a simulated Net F/T ("box").

    ``force`` is the axial force [N]. It is a function of the times since power-up [s], or an array
    of samples at 7000 Hz that are repeated. ``noise_counts`` is the standard deviation of the
    noise of every component. A restart resets all settings. The low-pass filter can be set, but
    has no effect.
    """

    def __init__(
        self,
        force,
        *,
        axis='fz',
        counts_per_force=1_000_000,
        force_unit='N',
        noise_counts=500.0,
        serial='FT00000',
    ):
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
        self._faults = {}  # end [s] and fraction of affected datagrams, by kind of fault
        self._command = Command.STOP
        self._record = 0
        self._ticks = self._shown = 0  # tick of the newest record, and tick that it contains
        self._status = 0
        self._held = []  # records of the next datagram, which is not full yet
        self._overtaken = []
        self._delayed = []  # datagrams that the fault "burst" delays

    def fault(self, kind, now_s, duration_s=np.inf, fraction=0.1):
        """Begin a fault. If no duration is given, the fault lasts until `heal` is called.

        The kinds are burst, mute, restart, saturate, stale, status, stuck, unplug, drop,
        duplicate, reorder and garbage. The last four affect a fraction of the datagrams.
        """
        if kind == 'restart':
            self._begun_s = now_s + duration_s
            self.settings = dict(_STORED)
            self._stop()
            self._delayed.clear()
        self._faults[kind] = (now_s + duration_s, fraction)

    def heal(self):
        self._faults.clear()

    def has(self, kind, now_s):
        return kind in self._faults and now_s < self._faults[kind][0]

    def is_away(self, now_s):
        """Return True while the box is unplugged or restarts, and does not answer."""
        return self.has('unplug', now_s) or self.has('restart', now_s)

    def answer(self, path):
        """Return a web page, or None if it does not exist. A query in the path sets settings."""
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

    def _describe(self):
        tags = {
            **self._identity,
            'runstat': f'0x{self._status:08x}',
            'runrate': INTERNAL_RATE_HZ,
            'setuserfilter': self.settings['setuserfilter'],
            'comrdte': 'Enabled' if self.settings['comrdte'] else 'Disabled',
            # The rate is rounded to an integer, as in a box with firmware 2.2.59.
            'comrdtrate': INTERNAL_RATE_HZ // self._divisor,
            'comrdtbsiz': self.settings['comrdtbsiz'],
        }
        body = ''.join(f'<{name}>{value}</{name}>' for name, value in tags.items())
        return f'<?xml version="1.0"?><netft>{body}</netft>'.encode()

    @property
    def _divisor(self):
        return INTERNAL_RATE_HZ // self.settings['comrdtrate']

    def command(self, command, now_s):
        """Execute an RDT request."""
        if self.is_away(now_s) or not self.settings['comrdte']:
            return
        self._stop()
        if command is not Command.STOP:
            self._command = command
            self._ticks = self._count(now_s)

    def _stop(self):
        self._command = Command.STOP
        self._record = 0
        self._held.clear()

    def _count(self, now_s):
        return max(0, int((now_s - self._begun_s) * INTERNAL_RATE_HZ))

    def poll(self, now_s):
        """Return the datagrams that must be sent now."""
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

    def _measure(self, ticks, now_s):
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

    def _pack(self, records):
        self._held.append(records)
        waiting = np.concatenate(self._held).astype(RECORD)  # now big-endian, as in datagrams
        is_buffered = self._command is Command.START_BUFFERED
        size = self.settings['comrdtbsiz'] if is_buffered else 1
        whole = len(waiting) // size * size
        self._held = [waiting[whole:]]
        return [waiting[i : i + size].tobytes() for i in range(0, whole, size)]

    def _spoil(self, datagrams, now_s):
        sent = []
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

    def _happens(self, kind, now_s):
        return self.has(kind, now_s) and self._generator.random() < self._faults[kind][1]


def _repeat(samples_n):
    def force(times_s):
        return samples_n[np.rint(times_s * INTERNAL_RATE_HZ).astype(np.int64) % len(samples_n)]

    return force


class NetFtDevice:
    """Runs a `NetFtBox` in real time, with sockets for UDP and HTTP.

    The stream is sent to the client that requested it last, about a millisecond late at most.
    ``failure`` is the exception that ended one of the threads, or None.
    """

    def __init__(self, box):
        self._box = box
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((HOST, 0))
        self.rdt_port = self._socket.getsockname()[1]
        self._web = _Web(self)
        self.http_port = self._web.server_address[1]
        self.failure = None
        self._begun_s = time.monotonic()
        self._peer = None
        self._threads = [
            threading.Thread(target=self._run, daemon=True),
            threading.Thread(target=self._web.serve_forever, args=(0.05,), daemon=True),
        ]

    def __enter__(self):
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *exception):
        self._stopping.set()
        self._web.shutdown()
        for thread in self._threads:
            thread.join()
        self._web.server_close()
        self._socket.close()

    @property
    def now_s(self):
        """Time since power-up [s]."""
        return time.monotonic() - self._begun_s

    def fault(self, kind, *duration_s, **options):
        with self._lock:
            self._box.fault(kind, self.now_s, *duration_s, **options)

    def heal(self):
        with self._lock:
            self._box.heal()

    def read_settings(self):
        """Return the present settings by their names on the web pages."""
        with self._lock:
            return dict(self._box.settings)

    def answer(self, path):
        """Return HTTP status and page, or None if the box does not answer."""
        with self._lock:
            if self._box.is_away(self.now_s):
                return None
            page = self._box.answer(path)
        return (404, b'') if page is None else (200, page)

    def _run(self):
        try:
            while not self._stopping.is_set():
                self._serve()
        except Exception as error:
            self.failure = error

    def _serve(self):
        request = b''
        if select.select([self._socket], [], [], _SLICE_S)[0]:
            # The error is raised if a datagram was sent to a client that has closed its socket.
            with contextlib.suppress(ConnectionError):
                request, peer = self._socket.recvfrom(64)
        with self._lock:
            if len(request) == 8:
                header, command, _ = struct.unpack('>HHI', request)
                assert header == 0x1234
                self._box.command(Command(command), self.now_s)
                self._peer = peer
            datagrams = self._box.poll(self.now_s)
        if self._peer is not None:
            for datagram in datagrams:
                with contextlib.suppress(ConnectionError, BlockingIOError):
                    self._socket.sendto(datagram, self._peer)


class _Web(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, device):
        self.device = device
        super().__init__((HOST, 0), _Handler)


class _Handler(BaseHTTPRequestHandler):
    def do_GET(self):
        answer = self.server.device.answer(self.path)
        if answer is None:
            self.close_connection = True
            return
        status, page = answer
        self.send_response(status)
        self.send_header('Content-Length', str(len(page)))
        self.end_headers()
        self.wfile.write(page)

    def log_message(self, *_):
        """Suppress the log messages of the base class."""
