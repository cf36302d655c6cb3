# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The ATI Digital F/T as a client sees it: open it and take the blocks."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from types import TracebackType

from tendon_sensor_driver.digital_ft_link import DigitalFtLink
from tendon_sensor_driver.digital_ft_protocol import describe_status
from tendon_sensor_driver.digital_ft_stream import DigitalFtStream
from tendon_sensor_driver.errors import LinkError, TendonSensorError
from tendon_sensor_driver.records import Block, Health, StrainStatus, TendonSensorConfig

FIRST_DELAY_S = 0.25
LONGEST_DELAY_S = 0.5
_JOIN_TIMEOUT_S = 5.0
_DEAD_S = 0.6

_logger = logging.getLogger(__name__)


class DigitalFtClient:
    """Reads one Digital F/T and hands out blocks of tension and wrench until it is closed.

    Not tried on hardware. Opening it stops a stream that is left over, reads status and
    calibration from the device, makes that calibration's gains the active ones and starts
    the stream; after every loss of the link the same is done again, first after 0.25 s, then
    every 0.5 s. When the stream marks an error, it is stopped to
    read the status word, at most once until the mark goes away.

    Parameters
    ----------
    config : TendonSensorConfig
    on_block : callable
        ``on_block(block)``; called on the client's thread.
    now_ns : callable
        The present ROS time [ns].
    """

    def __init__(
        self,
        config: TendonSensorConfig,
        on_block: Callable[[Block], None],
        now_ns: Callable[[], int],
    ) -> None:
        self._config = config
        self._on_block = on_block
        self._now_ns = now_ns
        self._stream = DigitalFtStream(config)
        self._link: DigitalFtLink | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='digital-ft', daemon=True)
        self.identity = ''
        self._is_connected = False
        self._heard_at_ns = self._connected_at_ns = 0
        self._delay_s = FIRST_DELAY_S
        self._reconnects = 0
        self._status_word = 0
        self._is_marked = False
        self._last_error = ''

    def __enter__(self) -> DigitalFtClient:
        self.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def open(self) -> None:
        """Read the calibration and start the stream.

        Raises
        ------
        LinkError
            When there is no Digital F/T at the port.
        TendonSensorError
            When this client has been opened before.
        """
        if self._thread.ident is not None or self._stop.is_set():
            raise TendonSensorError('this client has been opened before; make a new one')
        _logger.warning('the driver of the ATI Digital F/T has not been tried on hardware')
        self._link = self._connect()
        self._heard_at_ns = self._now_ns()
        self._is_connected = True
        self._thread.start()

    def close(self) -> None:
        """Hand out what has arrived and stop the stream. Harmless when called twice."""
        self._stop.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(_JOIN_TIMEOUT_S)

    def health(self) -> Health:
        """Return the state of the link now."""
        stream = self._stream
        return Health(
            is_connected=self._is_connected,
            heard_at_ns=self._heard_at_ns,
            bytes=stream.decoder.bytes,
            lines=stream.decoder.records,
            readings=stream.readings,
            rejected_lines=stream.decoder.dropped_bytes // 13,
            lost_samples=stream.lost_samples,
            reconnects=self._reconnects,
            status=stream.status,
            device_status=', '.join(describe_status(self._status_word)),
            rate_hz=stream.rate_hz,
            last_error=self._last_error,
        )

    def _run(self) -> None:
        while not self._stop.is_set():
            self._step()
        self._deliver(self._stream.flush())
        self._is_connected = False
        self._disconnect()

    def _step(self) -> None:
        try:
            if self._link is None:
                self._link = self._connect()
            self._read(self._link)
        except LinkError as error:
            self._is_connected = False
            self._last_error = str(error)
            self._deliver(self._stream.flush())
            self._disconnect()
            self._stop.wait(self._delay_s)
            self._delay_s = min(2 * self._delay_s, LONGEST_DELAY_S)

    def _connect(self) -> DigitalFtLink:
        link = DigitalFtLink(self._config.port, self._config.baud)
        try:
            link.stop_stream()
            self._status_word = link.read_status()
            calibration = link.read_calibration(self._config.calibration_slot)
            link.set_gauges(calibration.gauge_settings)
            link.start_stream()
        except LinkError:
            link.close()
            raise
        self.identity = calibration.serial
        self._stream.begin_session(calibration)
        self._connected_at_ns = self._now_ns()
        return link

    def _disconnect(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def _read(self, link: DigitalFtLink) -> None:
        data = link.read()
        received_at_ns = self._now_ns()
        records = self._stream.decoder.records
        if data:
            self._deliver(self._stream.add(data, received_at_ns))
        if self._stream.decoder.records > records:
            self._heard_at_ns = received_at_ns
            self._delay_s = FIRST_DELAY_S
            if not self._is_connected:
                self._is_connected = True
                self._reconnects += 1
        elif received_at_ns - max(self._heard_at_ns, self._connected_at_ns) > _DEAD_S * 1e9:
            raise LinkError(
                f'no records from the Digital F/T at {self._config.port} for {_DEAD_S} s; '
                'check its power and cable'
            )
        is_marked = StrainStatus.DEVICE_ERROR in self._stream.status
        if is_marked and not self._is_marked:
            self._is_marked = True
            raise LinkError('the Digital F/T marks an error; its stream is stopped to ask which')
        if self._is_marked and not is_marked:
            self._status_word = 0
        self._is_marked = is_marked

    def _deliver(self, blocks: list[Block]) -> None:
        try:
            for block in blocks:
                self._on_block(block)
        except Exception as error:
            # The stream outlives a fault of its consumer, which is told once.
            text = f'the consumer of the blocks failed: {error}'
            if text != self._last_error:
                self._last_error = text
                _logger.exception('the consumer of the blocks failed')
