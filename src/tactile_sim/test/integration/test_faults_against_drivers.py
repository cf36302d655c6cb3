# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The real drivers detect or tolerate every fault of the simulated rig, and then recover."""

from multiprocessing.pool import ThreadPool
import time

import numpy as np
import pytest

from linear_guide_driver import (
    LinearGuideClient,
    LinearGuideConfig,
    LinearGuideDriverError,
    TendonActuatorClient,
    TendonActuatorConfig,
)
from tactile_sim import SimulatedRig
from tactile_sim.devices.faults import KINDS
from tactile_testing.simulated_rigs import (
    advance_rig,
    home_fast,
    let_servos_pause,
    truth_at_rest,
)
from tactile_testing.waiting import wait_until
from tendon_sensor_driver import StrainStatus, TendonSensorConfig
from tendon_sensor_driver.sensors import make_sensor


@pytest.fixture(scope='module')
def rig():
    with SimulatedRig(seed=3) as rig:
        yield rig


@pytest.fixture(autouse=True)
def _sound_again(rig):
    yield
    for device in KINDS:
        rig.fault(device, 'none')


# -- sensor --------------------------------------------------------------------------------


class Listener:
    """Stores the blocks of a sensor client, and compares its counters with earlier values."""

    def __init__(self, port):
        self.blocks = []
        config = TendonSensorConfig(port=port, saturation_n=19.0)
        self.client = make_sensor(config, self.blocks.append, time.time_ns)
        self.client.open()

    @property
    def health(self):
        return self.client.health()

    @property
    def silence_s(self):
        return (time.time_ns() - self.health.heard_at_ns) * 1e-9

    def gained(self, counter):
        return getattr(self.health, counter) - getattr(self.before, counter)

    def has_status(self, bits):
        return bool(self.blocks and self.blocks[-1].status & bits)

    def wait_for_blocks(self, count):
        """Wait for ``count`` more blocks, and store the counters for `gained`."""
        start = len(self.blocks)
        wait_until(lambda: len(self.blocks) >= start + count, lambda: str(self.health))
        self.before = self.health


@pytest.fixture(scope='module')
def listener(rig):
    listener = Listener(rig.ports.sensor)
    listener.wait_for_blocks(30)  # a restart right at the start would only make samples late
    yield listener
    listener.client.close()


def loses_lines(it):
    return it.gained('rejected_lines') > 3 and it.gained('lost_samples') > 3


SENSOR_FAULTS = {
    'unplug': ({}, lambda it: not it.health.is_connected),
    'mute': ({}, lambda it: it.silence_s > 0.5),
    'burst': ({'period_s': 0.2}, lambda it: it.gained('bursts') > 1),
    'garbage': ({}, loses_lines),
    'split': ({}, loses_lines),
    'wrong_baud': ({'ratio': 3.0}, lambda it: it.silence_s > 0.5),
    'drop': ({'count': 5}, lambda it: it.gained('lost_samples') >= 5),
    'saturate': ({}, lambda it: it.has_status(StrainStatus.SATURATED)),
    'stuck': ({}, lambda it: it.has_status(StrainStatus.STUCK)),
    'restart': ({}, lambda it: it.gained('restarts') == 1),
    # The board is in its settings menu. The driver makes it leave the menu, but samples are lost.
    'menu': ({}, lambda it: it.gained('lost_samples') > 10),
    # A board that receives nothing still sends its lines.
    'deaf': ({}, lambda it: len(it.blocks) > 10),
}


@pytest.mark.parametrize('kind', KINDS['sensor'])
def test_the_sensor_driver_notices_and_comes_back(rig, listener, kind):
    listener.wait_for_blocks(5)
    listener.blocks.clear()
    options, is_noticed = SENSOR_FAULTS[kind]
    rig.fault('sensor', kind, **options)
    wait_until(lambda: is_noticed(listener), lambda: f'{kind} is not noticed: {listener.health}')
    rig.fault('sensor', 'none')
    listener.wait_for_blocks(10)
    bad = StrainStatus.SATURATED | StrainStatus.STUCK
    wait_until(lambda: not listener.has_status(bad), 'the status stays bad')
    assert listener.health.is_connected
    # No block is repeated, and all values are close to zero, as the sensor is unloaded.
    blocks = listener.blocks[:]
    sequence = [block.sequence for block in blocks]
    assert sequence == sorted(set(sequence))
    tension_n = np.concatenate([b.tension_n for b in blocks if not b.status & bad])
    assert np.abs(tension_n).max() < 1.0


# -- guide ---------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def begin():
    """Yield a function that starts a blocking motion on another thread and returns its future."""
    with ThreadPool(1) as pool:
        yield pool.apply_async


@pytest.fixture(scope='module')
def guide(rig):
    home_fast(rig)
    client = LinearGuideClient(LinearGuideConfig(port=rig.ports.guide))
    client.connect()
    client.home()
    yield client
    client.close()


@pytest.mark.parametrize(
    ('kind', 'options', 'reason'),
    [
        ('unplug', {}, 'lost'),
        ('deaf', {}, ''),
        ('garbage', {'share': 1.0}, ''),
        ('drop', {'count': 1}, ''),
        ('alarm', {}, 'limit'),
        ('restart', {}, ''),
    ],
)
def test_a_fault_ends_a_move_and_asks_for_homing(rig, guide, begin, kind, options, reason):
    start_m = rig.truth()['guide_position_m']
    motion = begin(guide.move_to, (0.06, 0.03))
    wait_until(lambda: rig.truth()['guide_position_m'] > start_m + 0.002, 'it does not move')
    rig.fault('guide', kind, **options)
    with pytest.raises(LinearGuideDriverError, match=reason):
        motion.get(30.0)
    assert guide.trouble
    with pytest.raises(LinearGuideDriverError):
        guide.move_to(0.05, 0.03)
    rig.fault('guide', 'none')
    # The end of the fault must not let the guide move again.
    truth_at_rest(rig)
    guide.home()
    assert guide.trouble is None


@pytest.mark.parametrize(
    ('kind', 'options', 'target_m'), [('burst', {'period_s': 0.1}, 0.02), ('stall', {}, 0.04)]
)
def test_a_guide_gets_over_late_answers_and_a_stall(rig, guide, kind, options, target_m):
    rig.fault('guide', kind, **options)
    guide.move_to(target_m, 0.03)
    assert rig.truth()['guide_position_m'] == pytest.approx(target_m, abs=1e-4)
    assert guide.trouble is None


# -- tendon --------------------------------------------------------------------------------


@pytest.fixture
def tendon(rig):
    rig.fault('tendon', 'restart')
    config = TendonActuatorConfig(port=rig.ports.tendon, watchdog_s=2.0, unguarded=True)
    client = TendonActuatorClient(config)

    def connect():
        try:
            client.connect()
        except LinearGuideDriverError:
            return False
        return True

    wait_until(connect, 'no connection')
    yield client
    client.close()


@pytest.mark.parametrize(
    ('kind', 'options', 'reason'),
    [
        ('unplug', {}, 'lost'),
        ('deaf', {}, 'silent'),
        ('corrupt', {'share': 1.0}, 'silent'),
        ('overheat', {}, 'overheating'),
        ('overload', {}, 'overload'),
        ('restart', {}, ''),
    ],
)
def test_a_fault_ends_a_pull_with_its_reason(rig, tendon, begin, kind, options, reason):
    start_m = wait_until(lambda: tendon.state, 'no state').displacement_m
    motion = begin(tendon.pull_to, (0.008, 0.002))

    def is_winding():
        assert not motion.ready(), motion.get(0)
        return tendon.state.displacement_m > start_m + 5e-4

    wait_until(is_winding, lambda: f'it does not wind: {tendon.state}, {tendon.trouble}')
    rig.fault('tendon', kind, **options)
    with pytest.raises(LinearGuideDriverError, match=reason):
        motion.get(30.0)
    # The end of the fault must not let the tendon continue the motion that was stopped.
    rest_m = rig.truth()['tendon_displacement_m']
    assert rest_m < 0.007
    rig.fault('tendon', 'none')
    assert advance_rig(rig, 0.2)['tendon_displacement_m'] <= rest_m + 1e-3


@pytest.mark.parametrize(
    ('kind', 'options'), [('drop', {'count': 1}), ('noise', {}), ('garbage', {'share': 0.1})]
)
def test_a_disturbed_bus_does_not_end_a_pull(rig, tendon, monkeypatch, kind, options):
    let_servos_pause(monkeypatch)  # the fault can damage several consecutive answers
    rig.fault('tendon', kind, **options)
    tendon.pull_to(0.002, 0.004)
    assert rig.truth()['tendon_displacement_m'] == pytest.approx(0.002, abs=1e-3)
    assert tendon.trouble is None
