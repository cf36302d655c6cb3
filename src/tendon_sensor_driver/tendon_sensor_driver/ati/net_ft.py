# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ATI Net F/T as a client sees it: open it and take the blocks."""

from __future__ import annotations

from tactile_ros.strain import StrainBlock
from tendon_sensor_driver.ati.counter_clock import CounterClock, CounterRestartError
from tendon_sensor_driver.ati.net_ft_link import LinkCounts, NetFtLink
from tendon_sensor_driver.ati.net_ft_protocol import compute_rate_hz, MOST_RECORDS
from tendon_sensor_driver.ati.net_ft_web import BoxConfiguration, BoxWeb
from tendon_sensor_driver.client_base import LinkClient, NowNs, OnBlock
from tendon_sensor_driver.errors import LinkError
from tendon_sensor_driver.records import Health, TendonSensorConfig
from tendon_sensor_driver.stream.strain_stream import Stream


class NetFtClient(LinkClient[NetFtLink]):
    """Reads one Net F/T and hands out blocks of tension and wrench until it is closed.

    Opening it reads the box's configuration from its web server, sets rate, filter and
    buffer where they differ, reads back what the box made of them, and starts the stream;
    after every loss of the link the same is done again.

    One thread reads, decodes and calls ``on_block``; while that does not return, the kernel
    keeps what arrives, and what does not fit there is counted as lost.
    """

    def __init__(self, config: TendonSensorConfig, on_block: OnBlock, now_ns: NowNs) -> None:
        super().__init__(config, on_block, now_ns)
        self._web = BoxWeb(config.host, config.http_port)
        self._stream = Stream(config, CounterClock())
        self._before = LinkCounts()  # of the links before this one
        self._seen_rejected = 0

    def health(self) -> Health:
        """Return the state of the link now."""
        stream, clock, link = self._stream, self._stream.clock, self._link
        counts = self._before
        if link is not None:
            counts = counts.plus(link.counts)
        return self._make_health(
            bytes=counts.bytes,
            lines=counts.datagrams,
            readings=stream.readings,
            rejected_lines=counts.rejected,
            lost_samples=stream.lost_samples,
            duplicates=clock.duplicates,
            late_samples=clock.late_samples,
            outliers=clock.outliers,
            restarts=clock.restarts,
            status=stream.status,
            device_status='' if link is None else link.describe_status(),
            rate_hz=clock.rate_hz,
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
        """Give the box the settings that it lacks; return what it then says, and its rate."""
        config = self._config
        if config.rate_hz > box.internal_rate_hz:
            raise LinkError(
                f'the Net F/T samples at {box.internal_rate_hz:g} Hz and cannot send '
                f'{config.rate_hz:g} Hz; set a lower "rate_hz"'
            )
        wanted_hz = compute_rate_hz(max(1, round(config.rate_hz)), box.internal_rate_hz)
        # They lie in its flash memory: what is right already is not written again.
        if not self._is_set_up(box, wanted_hz):
            self._web.write_settings(config.rate_hz, config.low_pass_hz, config.block_samples)
            box = self._web.read_configuration()
        if not box.is_rdt_enabled:
            raise LinkError('the Net F/T keeps RDT disabled; enable it on its communications page')
        if box.low_pass_hz not in (config.low_pass_hz, -1):
            raise LinkError(
                f'the Net F/T was asked for a low pass of {config.low_pass_hz} Hz and has '
                f'{box.low_pass_hz} Hz; set another "low_pass_hz"'
            )
        rate_hz = compute_rate_hz(box.rdt_rate_hz or config.rate_hz, box.internal_rate_hz)
        if abs(rate_hz - wanted_hz) > 0.05 * wanted_hz:
            raise LinkError(
                f'the Net F/T was asked for {config.rate_hz:g} Hz and sends {rate_hz:.2f} Hz; '
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

    def _flush(self) -> list[StrainBlock]:
        return self._stream.flush()

    def _note_loss(self, link: NetFtLink) -> None:
        self._before = self._before.plus(link.counts)

    def _wants_pause(self, error: LinkError) -> bool:
        # A box that was restarted is there already.
        return not isinstance(error, CounterRestartError)

    def _read(self, link: NetFtLink) -> None:
        batch = link.read()
        rejected = link.counts.rejected
        if rejected != self._seen_rejected:
            self._seen_rejected = rejected
            self._stream.note_dropped_bytes()
        if batch is None:
            self._deliver(self._stream.flush())
            return
        step_ns = self._arrivals.take_step_ns()
        if step_ns:
            self._stream.note_clock_step(step_ns)
        readings = self._stream.readings
        self._deliver(self._stream.add(batch))
        if self._stream.readings != readings:
            self._note_samples()
