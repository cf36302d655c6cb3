# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Serves a simulated Net F/T on the loopback: RDT over UDP, settings over HTTP."""

from __future__ import annotations

import contextlib
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
import select
import socket
import struct
import threading
import time

from net_ft_box import NetFtBox

from tendon_sensor_driver.net_ft_protocol import Command

HOST = '127.0.0.1'
_SLICE_S = 0.001


def _decode_request(datagram: bytes) -> Command | None:
    if len(datagram) != 8:
        return None
    header, command, _ = struct.unpack('>HHI', datagram)
    is_ours = header == 0x1234 and command in list(Command)
    return Command(command) if is_ours else None


class NetFtDevice:
    """Runs a box by the host's clock.

    One client is served: the newest that asked for a stream, as with a real box. Real-time
    records leave within about a millisecond of being due; at 7000 Hz some leave together.

    Parameters
    ----------
    box : NetFtBox
        While the device runs, the box belongs to its threads; see `fault`.

    Attributes
    ----------
    rdt_port, http_port : int
        Where it listens, on `HOST`.
    failure : Exception or None
        What ended the thread.
    """

    def __init__(self, box: NetFtBox) -> None:
        self._box = box
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((HOST, 0))
        self.rdt_port = int(self._socket.getsockname()[1])
        self._web = _Web(self)
        self.http_port = int(self._web.server_address[1])
        self.failure: Exception | None = None
        self._begun_s = time.monotonic()
        self._peer: tuple[str, int] | None = None
        self._threads = [
            threading.Thread(target=self._run, daemon=True),
            threading.Thread(target=self._web.serve_forever, args=(0.05,), daemon=True),
        ]

    def __enter__(self) -> NetFtDevice:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._stopping.set()
        self._web.shutdown()
        for thread in self._threads:
            thread.join()
        self._web.server_close()
        self._socket.close()

    @property
    def now_s(self) -> float:
        """Time since power-up [s]."""
        return time.monotonic() - self._begun_s

    def fault(self, kind: str, duration_s: float | None = None, **options: float) -> None:
        """Begin a fault, see `NetFtBox.fault`."""
        with self._lock:
            self._box.fault(kind, self.now_s, duration_s, **options)

    def heal(self) -> None:
        """End all faults."""
        with self._lock:
            self._box.heal()

    def read_settings(self) -> dict[str, int]:
        """Return the settings that the box has now, by their names on its web pages."""
        with self._lock:
            return dict(self._box.settings)

    def answer(self, path: str) -> tuple[int, bytes] | None:
        """Return HTTP status and page, or None when the box is away."""
        with self._lock:
            if self._box.is_away(self.now_s):
                return None
            page = self._box.answer(path)
        return (404, b'') if page is None else (200, page)

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                self._serve()
        except Exception as error:
            self.failure = error

    def _serve(self) -> None:
        request, peer = b'', None
        if select.select([self._socket], [], [], _SLICE_S)[0]:
            # A client that has gone away answers what is sent to it with an error.
            with contextlib.suppress(ConnectionError):
                request, peer = self._socket.recvfrom(64)
        with self._lock:
            command = _decode_request(request)
            if command is not None:
                self._box.command(command, self.now_s)
                self._peer = peer
            datagrams = self._box.poll(self.now_s)
        if self._peer is not None:
            for datagram in datagrams:
                with contextlib.suppress(ConnectionError, BlockingIOError):
                    self._socket.sendto(datagram, self._peer)


class _Web(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, device: NetFtDevice) -> None:
        self.device = device
        super().__init__((HOST, 0), _Handler)


class _Handler(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        server = self.server
        assert isinstance(server, _Web)
        answer = server.device.answer(self.path)
        if answer is None:
            self.close_connection = True
            return
        status, page = answer
        self.send_response(status)
        self.send_header('Content-Length', str(len(page)))
        self.end_headers()
        self.wfile.write(page)

    def log_message(self, format: str, *arguments: object) -> None:
        """Say nothing."""
