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

"""The host's clock is set while a sensor sends: stamps follow, the device did not restart."""

import time

import pytest

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver import TendonSensorClient, TendonSensorConfig

SECOND_NS = 1_000_000_000
MS_NS = 1_000_000


class HostClock:
    """The host's time, which can be set."""

    def __init__(self):
        self.offset_ns = 0

    def now_ns(self):
        return time.monotonic_ns() + 10**9 * SECOND_NS + self.offset_ns


@pytest.fixture
def clock():
    return HostClock()


@pytest.fixture
def send(sensor, blocks, wait_for):
    """Send readings in real time, each with the device's own time, until so many have come."""

    def send(count):
        for _ in range(count):
            before = len(blocks)
            sensor.write_reading(time.monotonic_ns() // MS_NS % 2**32, 0.5 + before * 1e-5)
            wait_for(lambda before=before: len(blocks) > before)
            time.sleep(0.005)  # the board's pause between two readings

    return send


@pytest.fixture
def blocks():
    return []


@pytest.fixture
def client(sensor, blocks, clock):
    config = TendonSensorConfig(port=sensor.port, rate_hz=100.0)
    with TendonSensorClient(config, blocks.append, clock.now_ns) as client:
        sensor.write(b'\n')
        yield client


@pytest.mark.parametrize('step_s', [5, -5, 0.3, -0.3, 3600, -3600])
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
        assert -0.2 < (clock.now_ns() - block.stamp_ns) / 1e9 < 5.0
    apart_s = (after[0].stamp_ns - before[-1].stamp_ns) / 1e9
    assert apart_s == pytest.approx(step_s, abs=0.1)
    numbers = [block.sequence for block in blocks]
    assert numbers == sorted(set(numbers))


@pytest.mark.parametrize('step_s', [5, -5])
def test_a_step_of_the_clock_is_no_silence(client, clock, send, step_s):
    send(5)
    clock.offset_ns += step_s * SECOND_NS
    assert 0.0 <= (clock.now_ns() - client.health().heard_at_ns) / 1e9 < 2.0


def test_a_step_while_the_link_was_lost_is_told_with_its_return(
    client, sensor, blocks, clock, send, wait_for
):
    send(30)
    sensor.unplug()
    wait_for(lambda: not client.health().is_connected)
    clock.offset_ns -= 5 * SECOND_NS
    sensor.plug_in()
    wait_for(lambda: client.health().reconnects == 1)
    sensor.write(b'\n')
    send(1)
    assert blocks[-1].status & ~StrainStatus.RESYNCHRONISED == (
        StrainStatus.RECONNECTED | StrainStatus.CLOCK_STEP
    )
    assert client.health().restarts == 0
