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

"""The sensor as a client sees it: open it and take the blocks."""

from __future__ import annotations

from collections.abc import Callable
import queue
import threading
from typing import NamedTuple

from tendon_sensor_driver.client_base import BlockClient, FIRST_DELAY_S, JOIN_TIMEOUT_S
from tendon_sensor_driver.errors import LinkError
from tendon_sensor_driver.lines.line_protocol import LineDecoder
from tendon_sensor_driver.lines.transport import find_serial_number, SerialTransport
from tendon_sensor_driver.records import Block, Health, TendonSensorConfig
from tendon_sensor_driver.stream.strain_stream import StrainStream

LONGEST_DELAY_S = 1.0
_BURST_READINGS = 3
_MENU_PROMPT = b'>'
_QUEUED_CHUNKS = 1000


class _Chunk(NamedTuple):
    """Bytes with the time of their arrival and the connection that they came over."""

    data: bytes
    received_at_ns: int
    connection: int
    is_cut: bool  # bytes before these were dropped
    clock_step_ns: int  # of the host's clock before these arrived


class TendonSensorClient(BlockClient):
    """Reads one sensor and hands out blocks of tension until it is closed.

    One thread reads the port and notes when bytes arrive; a second one decodes them and
    calls ``on_block``, so that a slow consumer does not spoil the arrival times. Between
    them is a bounded queue: what does not fit is lost, counted, and visible in the blocks
    like any other lost sample. A port that is lost is opened again, first after 0.25 s,
    then after twice as long each time up to 1 s.

    A board that says nothing may be an OpenScale whose settings menu somebody left open. A
    carriage return makes the menu show itself and means nothing to a board that measures;
    the prompt of a menu is answered with the ``x`` that leaves it.

    A client is opened once; make a new one to open the port again.

    Parameters
    ----------
    config : TendonSensorConfig
    on_block : callable
        ``on_block(block)``; called on a thread of the client.
    now_ns : callable
        The present ROS time [ns].

    Examples
    --------
    >>> with TendonSensorClient(config, print, time.time_ns):  # doctest: +SKIP
    ...     time.sleep(10)
    """

    def __init__(
        self,
        config: TendonSensorConfig,
        on_block: Callable[[Block], None],
        now_ns: Callable[[], int],
    ) -> None:
        super().__init__(config, on_block, now_ns)
        self._decoder = LineDecoder(config)
        self._stream = StrainStream(config)
        self._chunks: queue.SimpleQueue[_Chunk | None] = queue.SimpleQueue()
        self._transport: SerialTransport | None = None
        self._reader = threading.Thread(target=self._read, name='sensor-reader', daemon=True)
        self._worker = threading.Thread(target=self._work, name='sensor-worker', daemon=True)
        self._overruns = 0
        self._bursts = 0
        self._identity = ''

    @property
    def identity(self) -> str:
        """Serial number of the USB adapter, empty when it has none."""
        return self._identity

    def open(self) -> None:
        """Open the port and start to read.

        Raises
        ------
        LinkError
            When the port cannot be opened.
        TendonSensorError
            When this client has been opened before.
        """
        self._check_is_new(self._reader)
        self._transport = SerialTransport(self._config.port, self._config.baud)
        self._identity = find_serial_number(self._config.port)
        self._note_heard()
        self._is_connected = True
        self._worker.start()
        self._reader.start()

    def close(self) -> None:
        """Hand out what has arrived and close the port. Harmless when called twice."""
        if self._stop.is_set():
            return
        self._stop.set()
        transport = self._transport
        if transport is None:
            return
        transport.cancel()
        self._reader.join(JOIN_TIMEOUT_S)
        self._chunks.put(None)
        if self._worker is not threading.current_thread():
            self._worker.join(JOIN_TIMEOUT_S)
            if self._worker.is_alive():
                self._last_error = 'the consumer of the blocks does not return'

    def health(self) -> Health:
        """Return the state of the link now."""
        decoder, stream = self._decoder, self._stream
        return Health(
            is_connected=self._is_connected,
            heard_at_ns=self._heard_at_ns,
            bytes=decoder.bytes,
            lines=decoder.lines,
            readings=decoder.readings,
            rejected_lines=decoder.rejected_lines,
            lost_samples=stream.lost_samples,
            duplicates=stream.duplicates,
            late_samples=stream.late_samples,
            outliers=stream.outliers,
            bursts=self._bursts,
            reconnects=self._reconnects,
            restarts=stream.restarts,
            overruns=self._overruns,
            status=stream.status,
            last_rejected=decoder.last_rejected.decode('ascii', 'backslashreplace'),
            last_error=self._last_error,
        )

    # -- the reading thread ------------------------------------------------------------

    def _read(self) -> None:
        is_cut, step_ns = False, 0
        transport = self._transport
        while transport is not None and not self._stop.is_set():
            try:
                data = transport.read()
            except LinkError as error:
                self._is_connected = False
                self._last_error = str(error)
                transport.close()
                transport = self._transport = self._reconnect()
                continue
            if not data:
                continue
            self._delay_s = FIRST_DELAY_S
            received_at_ns = self._arrivals.now_ns()
            step_ns += self._arrivals.take_step_ns()
            # This thread alone adds, so the queue cannot grow beyond its bound meanwhile.
            if self._chunks.qsize() < _QUEUED_CHUNKS:
                chunk = _Chunk(data, received_at_ns, self._reconnects, is_cut, step_ns)
                self._chunks.put(chunk)
                is_cut, step_ns = False, 0
            else:
                self._overruns += 1
                is_cut = True
        self._is_connected = False
        if transport is not None:
            transport.close()

    def _reconnect(self) -> SerialTransport | None:
        while not self._stop.wait(self._delay_s):
            self._delay_s = min(2 * self._delay_s, LONGEST_DELAY_S)
            try:
                transport = SerialTransport(self._config.port, self._config.baud)
            except LinkError as error:
                self._last_error = str(error)
            else:
                self._identity = find_serial_number(self._config.port)
                self._reconnects += 1
                self._is_connected = True
                return transport
        return None

    # -- the thread that decodes and delivers ------------------------------------------

    def _work(self) -> None:
        connection = 0
        while True:
            try:
                chunk = self._chunks.get(timeout=self._config.silence_s)
            except queue.Empty:
                self._deliver(self._stream.flush())
                if self._stop.is_set():
                    return
                self._leave_menu()
                continue
            if chunk is None:
                self._deliver(self._stream.flush())
                return
            if chunk.connection != connection:
                connection = chunk.connection
                self._decoder.reset()
                self._stream.note_reconnection()
            elif chunk.is_cut:
                self._decoder.reset()
                self._stream.note_dropped_bytes()
            if chunk.clock_step_ns:
                self._stream.note_clock_step(chunk.clock_step_ns)
            readings = self._decoder.feed(chunk.data, chunk.received_at_ns)
            self._bursts += len(readings) >= _BURST_READINGS
            for reading in readings:
                self._note_heard()
                self._deliver(self._stream.add(reading))

    def _leave_menu(self) -> None:
        transport = self._transport
        last = self._decoder.last_byte
        if not self._config.leave_menu or transport is None or not self._is_connected:
            return
        try:
            if last == _MENU_PROMPT:
                transport.write(b'x')
            elif not last:
                transport.write(b'\r')
        except LinkError as error:
            self._last_error = str(error)
