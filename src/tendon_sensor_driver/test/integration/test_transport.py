# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import os
import sys
import threading
import types

import pytest

from tendon_sensor_driver import LinkError
from tendon_sensor_driver.client import find_serial_number, SerialTransport


@pytest.fixture
def eager_switching():
    """Let threads take turns as often as possible, so that races show."""
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval_s)


def test_cancel_never_touches_a_port_that_is_being_closed(sensor, eager_switching):
    failures = []

    def cancel_until(closed, transport):
        try:
            while not closed.is_set():
                transport.cancel()
            transport.cancel()
        except OSError as error:
            failures.append(error)

    for _ in range(300):
        closed = threading.Event()
        transport = SerialTransport(sensor.port, 115200)
        thread = threading.Thread(target=cancel_until, args=(closed, transport))
        thread.start()
        transport.close()
        closed.set()
        thread.join()
    assert failures == []


def test_what_is_written_arrives(sensor):
    transport = SerialTransport(sensor.port, 115200)
    transport.write(b'x')
    assert sensor.read() == b'x'
    transport.close()
    with pytest.raises(LinkError, match='cannot write'):
        transport.write(b'x')


def test_the_serial_number_is_that_of_the_adapter_behind_the_name(sensor, monkeypatch):
    adapters = [
        types.SimpleNamespace(device='/dev/ttyUSB9', serial_number='other'),
        types.SimpleNamespace(device=os.path.realpath(sensor.port), serial_number='A50285BI'),
    ]
    monkeypatch.setattr('tendon_sensor_driver.client.list_ports.comports', lambda: adapters)
    assert find_serial_number(sensor.port) == 'A50285BI'
    adapters[1].serial_number = None
    assert find_serial_number(sensor.port) == ''
    assert find_serial_number('/dev/absent') == ''
