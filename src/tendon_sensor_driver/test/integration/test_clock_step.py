# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The host's clock is set while a sensor sends: stamps follow, the device did not restart."""

import pytest

from tactile_ros.strain import StrainStatus
from tactile_testing.waiting import wait_until
from tendon_sensor_driver import TendonSensorClient, TendonSensorConfig

SECOND_NS = 1_000_000_000
MS_NS = 1_000_000


class Clocks:
    """The host's monotonic time, which passes as a test says, and its time, which can be set."""

    def __init__(self):
        self.passed_ns = 0
        self.offset_ns = 10**9 * SECOND_NS

    def monotonic_ns(self):
        return self.passed_ns

    def now_ns(self):
        return self.passed_ns + self.offset_ns


@pytest.fixture
def clock(monkeypatch):
    clock = Clocks()
    monkeypatch.setattr('tendon_sensor_driver.clock.time', clock)
    return clock


@pytest.fixture
def send(sensor, blocks, clock):
    """Send readings, one in 10 ms, each with the device's own time, until so many have come."""

    def send(count):
        for _ in range(count):
            before = len(blocks)
            clock.passed_ns += 10 * MS_NS
            sensor.write_reading(clock.passed_ns // MS_NS, 0.5 + before * 1e-5)
            wait_until(lambda before=before: len(blocks) > before)

    return send


@pytest.fixture
def blocks():
    return []


@pytest.fixture
def client(sensor, blocks, clock, monkeypatch):
    # A busy computer is no slow consumer, whose input is dropped.
    monkeypatch.setattr('tendon_sensor_driver.line_sensor.LONGEST_DELIVERY_NS', 10**18)
    config = TendonSensorConfig(port=sensor.port, rate_hz=100.0)
    with TendonSensorClient(config, blocks.append, clock.now_ns) as client:
        sensor.write(b'\n')
        yield client


@pytest.mark.parametrize('step_s', [5, -0.3, 0.3, -3600])
def test_a_step_of_the_clock_is_no_restart(client, blocks, clock, send, step_s):
    send(60)
    clock.offset_ns += round(step_s * SECOND_NS)
    send(60)
    before, after = blocks[:60], blocks[60:]
    assert [block.status for block in before] == [StrainStatus.OK] * 60
    assert [block.status for block in after] == [StrainStatus.CLOCK_STEP] + [StrainStatus.OK] * 59
    health = client.health()
    assert (health.restarts, health.outliers, health.late_samples) == (0, 0, 0)
    # Stamps are of the clock as it is set now, at once.
    for block in (after[0], after[-1]):
        assert -0.2 < (clock.now_ns() - block.stamp_ns) / 1e9 < 1.0
    apart_s = (after[0].stamp_ns - before[-1].stamp_ns) / 1e9
    assert apart_s == pytest.approx(step_s, abs=0.02)
    numbers = [block.sequence for block in blocks]
    assert numbers == sorted(set(numbers))


@pytest.mark.parametrize('step_s', [5, -5])
def test_a_step_of_the_clock_is_no_silence(client, clock, send, step_s):
    send(5)
    clock.offset_ns += step_s * SECOND_NS
    assert 0.0 <= (clock.now_ns() - client.health().heard_at_ns) / 1e9 < 2.0


def test_a_step_while_the_link_was_lost_is_told_with_its_return(
    client, sensor, blocks, clock, send
):
    send(30)
    sensor.unplug()
    wait_until(lambda: not client.health().is_connected)
    clock.offset_ns -= 5 * SECOND_NS
    sensor.plug_in()
    wait_until(lambda: client.health().reconnects == 1)
    sensor.write(b'\n')
    send(1)
    assert blocks[-1].status & ~StrainStatus.RESYNCHRONISED == (
        StrainStatus.RECONNECTED | StrainStatus.CLOCK_STEP
    )
    assert client.health().restarts == 0
