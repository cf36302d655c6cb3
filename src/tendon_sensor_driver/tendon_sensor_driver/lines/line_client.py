# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sensor as a client sees it: open it and take the blocks."""

from __future__ import annotations

import time

from tactile_ros.strain import StrainBlock
from tendon_sensor_driver.client_base import LinkClient, NowNs, OnBlock
from tendon_sensor_driver.lines.line_protocol import describe_line, LineDecoder
from tendon_sensor_driver.records import Health, TendonSensorConfig
from tendon_sensor_driver.stream.strain_stream import StrainStream
from tendon_sensor_driver.transport import find_serial_number, SerialTransport

LONGEST_DELIVERY_NS = 250_000_000
"""Longest time a consumer may take before the kernel's serial buffer can overflow [ns]."""

_DROP_S = 0.05
_BURST_READINGS = 3
_MENU_PROMPT = b'>'


class TendonSensorClient(LinkClient[SerialTransport]):
    """Reads one sensor and hands out blocks of tension until it is closed.

    One thread reads, decodes and calls ``on_block``, which must return soon: bytes that come
    meanwhile are stamped late. If it takes longer than 0.25 s, what has come meanwhile is dropped,
    since the kernel may have dropped parts of it. That is counted, and visible in the blocks like
    any other lost sample.

    A board that says nothing may be an OpenScale whose settings menu somebody left open. A
    carriage return makes the menu show itself and means nothing to a board that measures;
    the prompt of a menu is answered with the ``x`` that leaves it.

    A client is opened once; make a new one to open the port again. Its ``identity`` is the serial
    number of the USB adapter.

    Examples
    --------
    >>> with TendonSensorClient(config, print, time.time_ns):  # doctest: +SKIP
    ...     time.sleep(10)
    """

    def __init__(self, config: TendonSensorConfig, on_block: OnBlock, now_ns: NowNs) -> None:
        super().__init__(config, on_block, now_ns)
        self._decoder = LineDecoder(config)
        self._stream = StrainStream(config)
        self._delivered_in_ns = 0
        self._overruns = 0
        self._bursts = 0

    def close(self) -> None:
        """Hand out what has arrived and close the port. Harmless when called twice."""
        self._stop.set()
        link = self._link
        if link is not None:
            link.cancel()
        super().close()

    def health(self) -> Health:
        """Return the state of the link now."""
        decoder, stream = self._decoder, self._stream
        return self._make_health(
            bytes=decoder.bytes,
            lines=decoder.lines,
            readings=decoder.readings,
            rejected_lines=decoder.rejected_lines,
            lost_samples=stream.lost_samples,
            duplicates=stream.clock.duplicates,
            late_samples=stream.clock.late_samples,
            outliers=stream.clock.outliers,
            bursts=self._bursts,
            restarts=stream.clock.restarts,
            overruns=self._overruns,
            status=stream.status,
            last_rejected=describe_line(decoder.last_rejected),
            last_reason=decoder.last_reason,
        )

    # -- the client's thread -----------------------------------------------------------

    def _connect(self) -> SerialTransport:
        link = SerialTransport(self._config.port, self._config.baud)
        self.identity = find_serial_number(self._config.port)
        if self._has_started:
            self._is_connected = True
            self._reconnects += 1
            self._decoder.reset()
            self._stream.note_reconnection()
        return link

    def _flush(self) -> list[StrainBlock]:
        return self._stream.flush()

    def _read(self, link: SerialTransport) -> None:
        if self._delivered_in_ns > LONGEST_DELIVERY_NS:
            self._drop_input(link)
        data = link.read(self._config.silence_s)
        if not data:
            self._deliver(self._stream.flush())
            self._leave_menu(link)
            return
        received_at_ns = self._arrivals.now_ns()
        step_ns = self._arrivals.take_step_ns()
        if step_ns:
            self._stream.note_clock_step(step_ns)
        began_ns = time.monotonic_ns()
        readings = self._decoder.feed(data, received_at_ns)
        self._bursts += len(readings) >= _BURST_READINGS
        if readings:
            newest = readings[-1]
            self._stream.clock.note_newest(newest.device_ticks, newest.received_at_ns)
        for reading in readings:
            self._note_samples()
            self._deliver(self._stream.add_reading(reading))
        self._delivered_in_ns = time.monotonic_ns() - began_ns

    def _drop_input(self, link: SerialTransport) -> None:
        """Drop what has come meanwhile: pieces of two lines may be joined in it."""
        end_s = time.monotonic() + _DROP_S
        while time.monotonic() < end_s:
            link.read(_DROP_S)
        self._decoder.reset()
        self._stream.note_dropped_bytes()
        self._delivered_in_ns = 0
        self._overruns += 1

    def _leave_menu(self, link: SerialTransport) -> None:
        last = self._decoder.last_byte
        if not self._config.leave_menu or self._stop.is_set():
            return
        if last == _MENU_PROMPT:
            link.write(b'x')
        elif not last:
            link.write(b'\r')
