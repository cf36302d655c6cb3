# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Client of the force-torque sensor ATI Net F/T, and its UDP link."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
import contextlib
import select
import socket
import time

import numpy as np
from numpy.typing import NDArray

from tendon_sensor_driver.client import LinkClient, NowNs, OnBlock
from tendon_sensor_driver.clock import Batch
from tendon_sensor_driver.config import AXES, TendonSensorConfig
from tendon_sensor_driver.counter_clock import CounterClock, CounterRestartError
from tendon_sensor_driver.errors import LinkError
from tendon_sensor_driver.net_ft_protocol import (
    BoxConfiguration,
    BoxWeb,
    classify_status,
    Command,
    compute_rate_hz,
    decode_records,
    encode_request,
    format_status,
    MOST_RECORDS,
    RECORD_BYTES,
)
from tendon_sensor_driver.strain_stream import Stream
from tendon_sensor_driver.types import SensorHealth

_WAIT_S = 0.1
_LONGEST_WAIT_S = 0.25
_DEAD_S = 0.6
_PERIODS = 6  # number of sample periods without data after which the request is repeated
_LONGEST_GATHER_S = 0.02
_MOST_DATAGRAMS = 4096  # largest number of datagrams that are read at once
_BUFFER_BYTES = 4 << 20


class NetFtLink:
    """A running stream of records from a Net F/T.

    In buffered mode, a datagram contains up to 40 records. The buffer of the kernel can then
    store the records of several hundred milliseconds at 7000 Hz while the host is busy.

    Parameters
    ----------
    config : TendonSensorConfig
        Address and axis of the sensor.
    box : BoxConfiguration
        Configuration that the sensor reports.
    rate_hz : float
        Rate of the records [Hz].
    now_ns : callable
        Returns the host's time [ns].

    Attributes
    ----------
    counts : Counter
        Received bytes, received datagrams, and rejected datagrams, which did not contain whole
        records.

    Raises
    ------
    LinkError
        If the host cannot be reached.
    """

    def __init__(
        self,
        config: TendonSensorConfig,
        box: BoxConfiguration,
        rate_hz: float,
        now_ns: Callable[[], int],
    ) -> None:
        self._host = config.host
        self._axis = AXES.index(config.axis)
        self._scale = config.scale
        self._is_axia = box.is_axia
        self._now_ns = now_ns
        self._gather_s = min((config.block_samples - 1) / rate_hz, _LONGEST_GATHER_S)
        self._missing_s = max(_WAIT_S, _PERIODS / rate_hz)
        self._dead_s = max(_DEAD_S, 2 * self._missing_s)
        self._wait_s = min(self._missing_s, _LONGEST_WAIT_S)
        self._heard_s = self._asked_s = time.monotonic()
        self._status_word = box.status
        self.counts = _no_counts()
        self._si_per_count = box.si_per_count
        self._start = (
            Command.START_BUFFERED
            if 1 < box.records_per_datagram <= MOST_RECORDS
            else Command.START_REALTIME
        )
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            # The kernel may provide a smaller buffer.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            self._socket.setblocking(False)
            # A connected socket only receives datagrams from the sensor.
            self._socket.connect((config.host, config.rdt_port))
            self._socket.send(encode_request(Command.STOP))
            self._socket.send(encode_request(self._start))
        except OSError as error:
            self._socket.close()
            raise LinkError(f'cannot reach the Net F/T at {config.host}: {error}') from error

    def format_status(self) -> str | None:
        """Return the errors that the newest record reports, comma-separated, or None."""
        return ', '.join(format_status(self._status_word, is_axia=self._is_axia)) or None

    def read(self) -> Batch | None:
        """Return the received samples, or None if no sample arrives within the wait time.

        The wait time is 0.25 s or less.

        Raises
        ------
        LinkError
            If the stream of records has ended.
        """
        try:
            if not select.select([self._socket], [], [], self._wait_s)[0]:
                if self._check_silence():  # the network may have lost the request
                    self._socket.send(encode_request(self._start))
                return None
            received_at_ns = self._now_ns()
            if self._gather_s:
                time.sleep(self._gather_s)
            datagrams = self._take_waiting()
        except OSError as error:
            raise LinkError(f'lost the Net F/T at {self._host}: {error}') from error
        good = [datagram for datagram in datagrams if _is_whole(datagram)]
        self.counts['bytes'] += sum(map(len, datagrams))
        self.counts['datagrams'] += len(datagrams)
        self.counts['rejected'] += len(datagrams) - len(good)
        if not good:
            self._check_silence()
            return None
        return self._decode(good, received_at_ns)

    def close(self) -> None:
        """Stop the stream and close the socket."""
        with contextlib.suppress(OSError):
            self._socket.send(encode_request(Command.STOP))
        self._socket.close()

    def _take_waiting(self) -> list[bytes]:
        datagrams: list[bytes] = []
        with contextlib.suppress(BlockingIOError):
            while len(datagrams) < _MOST_DATAGRAMS:
                datagrams.append(self._socket.recv(65536))
        return datagrams

    def _decode(self, datagrams: list[bytes], received_at_ns: int) -> Batch:
        """Return the records as a batch, and restart the time that `_check_silence` measures."""
        records: NDArray[np.void] = decode_records(b''.join(datagrams))
        words = records['status'].astype(np.uint32)
        self._heard_s = self._asked_s = time.monotonic()
        self._status_word = int(words[-1])
        wrench = records['counts'] * self._si_per_count
        return Batch(
            received_at_ns=received_at_ns,
            tension_n=self._scale * wrench[:, self._axis],
            ticks=records['ft_sequence'].astype(np.uint32),
            wrench=wrench,
            status=classify_status(words, is_axia=self._is_axia),
            # The time of arrival belongs to the last record of the first datagram, because a
            # datagram is sent as soon as its last record is complete.
            timed=len(datagrams[0]) // RECORD_BYTES - 1,
            records=records['rdt_sequence'].astype(np.uint32),
        )

    def _check_silence(self) -> bool:
        """Return True if the stream must be requested again.

        Raises `LinkError` if no record has arrived for too long.
        """
        now_s = time.monotonic()
        if now_s - self._heard_s > self._dead_s:
            raise LinkError(
                f'no records from the Net F/T at {self._host} for {now_s - self._heard_s:.1f} s; '
                'check its power and cable, and that no other program has started its stream'
            )
        if now_s - self._asked_s < self._missing_s:
            return False
        self._asked_s = now_s
        return True


def _no_counts() -> Counter[str]:
    return Counter(bytes=0, datagrams=0, rejected=0)


def _is_whole(datagram: bytes) -> bool:
    return 0 < len(datagram) <= MOST_RECORDS * RECORD_BYTES and not len(datagram) % RECORD_BYTES


class NetFtClient(LinkClient[NetFtLink]):
    """Client of a Net F/T, whose blocks contain both the tension and the wrench.

    When the client is opened, and after every loss of the link, it reads the configuration from
    the web server of the sensor. If rate, filter or number of records per datagram differ from
    the parameters, the client sets them and reads the configuration again. Then it starts the
    stream.

    One thread reads, decodes and calls ``on_block``. While ``on_block`` runs, the kernel stores
    the arriving datagrams. If its buffer is full, further samples are lost and are counted as
    such. See `SensorClient` for the parameters.
    """

    _stream: Stream[CounterClock]

    def __init__(self, config: TendonSensorConfig, on_block: OnBlock, now_ns: NowNs) -> None:
        super().__init__(config, on_block, now_ns)
        self._web = BoxWeb(config.host, config.http_port)
        self._stream = Stream(config, CounterClock())
        self._before = _no_counts()  # total of all closed links
        self._seen_rejected = 0

    def health(self) -> SensorHealth:
        link = self._link
        counts = self._before if link is None else self._before + link.counts
        return self._make_health(
            self._stream,
            bytes=counts['bytes'],
            lines=counts['datagrams'],
            rejected_lines=counts['rejected'],
            device_status=None if link is None else link.format_status(),
            rate_hz=self._stream.clock.rate_hz,
        )

    # -- the client's thread -----------------------------------------------------------

    def _connect(self) -> NetFtLink:
        box, rate_hz = self._set_up(self._web.read_configuration())
        link = NetFtLink(self._config, box, rate_hz, self._arrivals.now_ns)
        self._seen_rejected = 0
        self.identity = box.serial or box.product
        ticks_per_sample = round(box.internal_rate_hz / rate_hz)
        self._stream.clock.begin_session(box.internal_rate_hz, ticks_per_sample)
        if self._stream.readings:
            self._stream.note_reconnection()
        return link

    def _set_up(self, box: BoxConfiguration) -> tuple[BoxConfiguration, float]:
        """Change the sensor's settings if necessary; return its configuration and rate [Hz]."""
        config = self._config
        if config.rate_hz > box.internal_rate_hz:
            raise LinkError(
                f'the Net F/T samples at {box.internal_rate_hz:g} Hz and cannot send '
                f'{config.rate_hz:g} Hz; set a lower "rate_hz"'
            )
        wanted_hz = compute_rate_hz(max(1, round(config.rate_hz)), box.internal_rate_hz)
        # The sensor stores its settings in flash memory, which should not be written often.
        if not self._is_set_up(box, wanted_hz):
            self._web.write_settings(config.rate_hz, config.low_pass_hz, config.block_samples)
            box = self._web.read_configuration()
        if not box.is_rdt_enabled:
            raise LinkError(
                'RDT is still disabled in the Net F/T; enable it on its communications page'
            )
        if box.low_pass_hz not in (config.low_pass_hz, -1):
            raise LinkError(
                f'the low-pass filter of the Net F/T was set to {config.low_pass_hz} Hz, but it '
                f'reports {box.low_pass_hz} Hz; set another "low_pass_hz"'
            )
        rate_hz = compute_rate_hz(box.rdt_rate_hz or config.rate_hz, box.internal_rate_hz)
        if abs(rate_hz - wanted_hz) > 0.05 * wanted_hz:
            raise LinkError(
                f'the Net F/T was set to {config.rate_hz:g} Hz, but sends at {rate_hz:.2f} Hz; '
                'set another "rate_hz"'
            )
        return box, rate_hz

    def _is_set_up(self, box: BoxConfiguration, wanted_hz: float) -> bool:
        return (
            box.is_rdt_enabled
            and box.rdt_rate_hz > 0
            and compute_rate_hz(box.rdt_rate_hz, box.internal_rate_hz) == wanted_hz
            and box.low_pass_hz == self._config.low_pass_hz
            and box.records_per_datagram == min(self._config.block_samples, MOST_RECORDS)
        )

    def _note_loss(self, link: NetFtLink) -> None:
        # The Counter is replaced and not changed, because `health` runs on another thread.
        self._before = self._before + link.counts

    def _wants_pause(self, error: LinkError) -> bool:
        # A sensor that has restarted can be reached immediately.
        return not isinstance(error, CounterRestartError)

    def _read(self, link: NetFtLink) -> None:
        batch = link.read()
        rejected = link.counts['rejected']
        if rejected != self._seen_rejected:
            self._seen_rejected = rejected
            self._stream.note_dropped_bytes()
        if batch is None:
            self._deliver(self._stream.flush())
            return
        if self._arrivals.step_ns:
            self._stream.note_clock_step(self._arrivals.take_step_ns())
        readings = self._stream.readings
        self._deliver(self._stream.add(batch))
        if self._stream.readings != readings:
            self._note_samples(time.monotonic_ns())
