# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import sys
import threading

import pytest

from tendon_sensor_driver.transport import SerialTransport


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
