# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ATI Digital F/T as a client sees it: open it and take the blocks."""

from __future__ import annotations

import logging
import time

from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.ati.digital_ft_link import DigitalFtLink
from tendon_sensor_driver.ati.digital_ft_protocol import describe_status
from tendon_sensor_driver.ati.digital_ft_stream import DigitalFtStream
from tendon_sensor_driver.client_base import LinkClient, NowNs, OnBlock
from tendon_sensor_driver.errors import LinkError
from tendon_sensor_driver.records import Health, TendonSensorConfig

_DEAD_S = 0.6

_logger = logging.getLogger(__name__)


class DigitalFtClient(LinkClient[DigitalFtLink]):
    """Reads one Digital F/T and hands out blocks of tension and wrench until it is closed.

    Not tried on hardware. Opening it stops a stream that is left over, reads status and
    calibration from the device, makes that calibration's gains the active ones and starts
    the stream; after every loss of the link the same is done again. When the stream marks an
    error, it is stopped to read the status word, at most once until the mark goes away.
    """

    def __init__(self, config: TendonSensorConfig, on_block: OnBlock, now_ns: NowNs) -> None:
        super().__init__(config, on_block, now_ns)
        self._stream = DigitalFtStream(config)
        self._connected_monotonic_ns = 0
        self._status_word = 0
        self._is_marked = False

    def open(self) -> None:
        """Read the calibration and start the stream; see `LinkClient.open`."""
        _logger.warning('the driver of the ATI Digital F/T has not been tried on hardware')
        super().open()

    def health(self) -> Health:
        """Return the state of the link now."""
        stream = self._stream
        return self._make_health(
            bytes=stream.decoder.bytes,
            lines=stream.decoder.records,
            readings=stream.samples.readings,
            rejected_lines=stream.decoder.dropped_bytes // 13,
            lost_samples=stream.samples.lost_samples,
            status=stream.samples.status,
            device_status=', '.join(describe_status(self._status_word)),
            rate_hz=stream.rate_hz,
        )

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
        self._connected_monotonic_ns = time.monotonic_ns()
        return link

    def _flush(self) -> list[StrainBlock]:
        return self._stream.samples.flush()

    def _read(self, link: DigitalFtLink) -> None:
        data = link.read()
        received_at_ns = self._arrivals.now_ns()
        step_ns = self._arrivals.take_step_ns()
        if step_ns:
            self._stream.note_clock_step(step_ns)
        records = self._stream.decoder.records
        if data:
            self._deliver(self._stream.add(data, received_at_ns))
        if self._stream.decoder.records > records:
            self._note_samples()
        elif self._measure_silence_s() > _DEAD_S:
            raise LinkError(
                f'no records from the Digital F/T at {self._config.port} for {_DEAD_S} s; '
                'check its power and cable'
            )
        is_marked = StrainStatus.DEVICE_ERROR in self._stream.samples.status
        if is_marked and not self._is_marked:
            self._is_marked = True
            raise LinkError('the Digital F/T marks an error; its stream is stopped to ask which')
        if self._is_marked and not is_marked:
            self._status_word = 0
        self._is_marked = is_marked

    def _measure_silence_s(self) -> float:
        since_ns = max(self._heard_monotonic_ns, self._connected_monotonic_ns)
        return (time.monotonic_ns() - since_ns) / 1e9
