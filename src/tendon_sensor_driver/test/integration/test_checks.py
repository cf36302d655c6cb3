# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Clients of serial ports and of the Net F/T pass `check_sensor`, and wrong clients fail it.

The client of a force on a topic is checked in ``test/node/test_topic_node.py``.
"""

from contextlib import contextmanager
import dataclasses
import threading
import time

from net_ft_device import HOST, NetFtBox, NetFtDevice
import numpy as np
import pytest

from tendon_sensor_driver import (
    check_sensor,
    encode_reading,
    make_sensor,
    StrainBlock,
    TendonSensorConfig,
    TendonSensorError,
)
from tendon_sensor_driver.checks import SensorCheckError
from tendon_sensor_driver.client import SensorClient
from tendon_sensor_driver.types import SensorHealth

PERIOD_NS = 5_000_000


@contextmanager
def running(step):
    """Call ``step`` every 5 ms on a separate thread."""
    stop = threading.Event()

    def run():
        while not stop.wait(PERIOD_NS / 1e9):
            step()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.mark.parametrize('time_column', [0, -1])
def test_a_board_that_writes_lines_keeps_the_contract(sensor, time_column):
    config = TendonSensorConfig(
        port=sensor.port,
        time_column=time_column,
        line_columns=0 if time_column == 0 else 3,
        rate_hz=200.0,
    )
    began_ns = time.monotonic_ns()

    def write():
        ticks = (time.monotonic_ns() - began_ns) // 1_000_000
        sensor.write(encode_reading(ticks, 0.5 + ticks % 7))

    with running(write):
        check_sensor(lambda on_block, now_ns: make_sensor(config, on_block, now_ns))


@pytest.mark.parametrize('rate_hz', [100.0, 1000.0])
def test_a_net_ft_keeps_the_contract(rate_hz):
    with NetFtDevice(NetFtBox(lambda times_s: np.sin(times_s))) as device:
        config = TendonSensorConfig(
            sensor='net_ft',
            host=HOST,
            axis='fz',
            rdt_port=device.rdt_port,
            http_port=device.http_port,
            rate_hz=rate_hz,
        )
        check_sensor(lambda on_block, now_ns: make_sensor(config, on_block, now_ns))


class Counter(SensorClient):
    """A simple client that passes `check_sensor`; each subclass breaks one of its rules."""

    stamps = 1
    numbers = 1
    values = (0.5,)
    is_lasting = True
    is_repeatable = False

    def __init__(self, on_block, now_ns):
        super().__init__(TendonSensorConfig(), on_block, now_ns)
        self._thread = threading.Thread(target=self._run)
        self._is_open = False
        self._count = 0

    def open(self):
        if not self.is_repeatable:
            self._check_is_new(self._is_open)
        if not self._is_open:
            self._is_open = self._is_connected = True
            self._thread.start()

    def close(self):
        self._stop.set()
        if self.is_lasting:
            self._thread.join()
            self._is_connected = False

    def health(self):
        return SensorHealth(
            self._is_connected, self._host_ns(), readings=self._count, last_error=self._last_error
        )

    def _run(self):
        start_ns = self._host_ns()
        while not (self.is_lasting and self._stop.is_set()) and self._count < 1_000:
            stamp_ns = start_ns + self.stamps * self._count * PERIOD_NS
            number = self.numbers * self._count
            self._count += 1
            self._deliver([StrainBlock(stamp_ns, number, PERIOD_NS, np.array(self.values))])
            time.sleep(0.001)


class Naive(Counter):
    def _deliver(self, blocks):
        for block in blocks:
            self._on_block(block)


class Silent(Counter):
    values = ()

    def _deliver(self, blocks):
        pass


class Connected(Counter):
    def health(self):
        return dataclasses.replace(super().health(), is_connected=True)


def broken(**changes):
    return type('Broken', (Counter,), changes)


@pytest.mark.parametrize(
    ('code', 'sensor_class'),
    [
        ('health', Connected),
        ('open', broken(is_repeatable=True)),
        ('silent', Silent),
        ('block', broken(values=(float('nan'),))),
        ('block', broken(values=())),
        ('order', broken(numbers=2)),
        ('order', broken(stamps=-1)),
        ('close', broken(is_lasting=False)),
        pytest.param(
            'consumer',
            Naive,
            marks=pytest.mark.filterwarnings(
                'ignore::pytest.PytestUnhandledThreadExceptionWarning'
            ),
        ),
    ],
)
def test_a_sensor_that_breaks_the_contract_is_told_how(code, sensor_class):
    with pytest.raises(SensorCheckError) as caught:
        check_sensor(sensor_class, timeout_s=2.0 if code in ('silent', 'consumer') else 20.0)
    assert caught.value.code == code


def test_a_sensor_of_ones_own_keeps_the_contract():
    check_sensor(Counter)
    assert issubclass(SensorCheckError, TendonSensorError)
