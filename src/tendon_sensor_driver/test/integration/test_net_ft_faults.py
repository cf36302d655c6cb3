# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults of a simulated Net F/T and of the network, and how the client handles them."""

from itertools import pairwise
import threading
import time

from net_ft_device import HOST, NetFtBox, NetFtDevice
import numpy as np
import pytest

from tactile_testing.waiting import wait_until
from tendon_sensor_driver import LinkError, net_ft, StrainStatus, TendonSensorConfig
from tendon_sensor_driver.net_ft import NetFtClient
from tendon_sensor_driver.net_ft_protocol import format_status

INTERNAL_HZ = 7000
STEP_N = 1e-4  # change of the force from one tick to the next
SLOW, FAST = (100.0, 1), (2000.0, 20)  # rate [Hz], and number of records per datagram
BOTH = pytest.mark.parametrize('way', [SLOW, FAST], ids=['single', 'buffered'])


def ramp(times_s):
    """Return forces that increase with every tick, so that they identify the tick."""
    return np.rint(times_s * INTERNAL_HZ) * STEP_N


class Recorder:
    def __init__(self):
        self.blocks = []
        self.lock = threading.Lock()

    def __call__(self, block):
        with self.lock:
            self.blocks.append(block)

    def take(self):
        with self.lock:
            return list(self.blocks)

    def status(self, since=0):
        bits = StrainStatus.OK
        for block in self.take()[since:]:
            bits |= block.status
        return bits

    def samples(self):
        return sum(len(block.tension_n) for block in self.take())


class Rig:
    def __init__(self, device, client, recorder):
        self.device, self.client, self.recorder = device, client, recorder

    @property
    def health(self):
        return self.client.health()

    def await_more(self, count=20):
        samples = self.recorder.samples()
        wait_until(lambda: self.recorder.samples() > samples + count)


def configure(device, way, **changes):
    rate_hz, samples_per_block = way
    return TendonSensorConfig(
        **{
            'sensor': 'net_ft',
            'host': HOST,
            'rdt_port': device.rdt_port,
            'http_port': device.http_port,
            'rate_hz': rate_hz,
            'samples_per_block': samples_per_block,
            'stuck_s': 0.2,
            **changes,
        }
    )


@pytest.fixture
def rig(way, monkeypatch):
    monkeypatch.setattr(net_ft, '_DEAD_S', 0.4)
    with NetFtDevice(NetFtBox(ramp, noise_counts=0.0)) as device:
        recorder = Recorder()
        with NetFtClient(configure(device, way), recorder, time.time_ns) as client:
            wait_until(lambda: recorder.samples() > 10)
            yield Rig(device, client, recorder)
        assert device.failure is None


def check_samples(rig, divisor, *, is_running=False):
    """Check that all samples were measured by the box, with right numbers and no repetition."""
    expected = stamp_ns = 0
    first = None
    for block in rig.recorder.take():
        assert block.sequence == expected + block.lost_before
        numbers = block.sequence + np.arange(len(block.tension_n))
        ticks = np.rint(block.tension_n / STEP_N).astype(int)
        first = ticks[0] if first is None else first
        np.testing.assert_array_equal(ticks - first, divisor * numbers)
        np.testing.assert_array_equal(block.wrench[:, 2], block.tension_n)
        assert block.stamp_ns > stamp_ns
        stamp_ns = block.stamp_ns + (len(numbers) - 1) * block.period_ns
        expected = block.sequence + len(numbers)
    assert is_running or rig.health.lost_samples == expected - rig.recorder.samples()


def divisor(way):
    return int(INTERNAL_HZ / way[0])


@pytest.mark.parametrize('way', [(60.0, 1), SLOW, FAST], ids=['60 Hz', 'single', 'buffered'])
def test_all_samples_arrive_in_order_with_the_true_period(rig, way):
    rig.await_more(0.3 * way[0])
    rig.client.close()
    check_samples(rig, divisor(way))
    assert rig.health.lost_samples == 0
    assert rig.recorder.status() == StrainStatus.OK
    assert rig.health.rate_hz == INTERNAL_HZ / divisor(way)  # the rate to which it was rounded
    assert rig.recorder.take()[-1].period_ns == round(divisor(way) * 1e9 / INTERNAL_HZ)
    assert rig.client.identity == 'FT00000'
    settings = rig.device.read_settings()
    assert settings['setuserfilter'] == 6  # the code of 18 Hz
    assert settings['comrdtrate'] == way[0]


@BOTH
def test_what_the_network_and_the_box_do_is_counted_and_invents_nothing(rig, way):
    rig.device.fault('burst', 0.05)
    rig.await_more(0.2 * way[0])
    assert rig.health.lost_samples == 0  # delayed datagrams are not lost
    counts = {
        'duplicate': lambda: rig.health.duplicates,
        'reorder': lambda: rig.recorder.samples() // 8,  # it is enough that some samples arrive
        'garbage': lambda: rig.health.rejected_lines,
        'drop': lambda: rig.health.lost_samples,
    }
    for kind, count in counts.items():
        before = count()
        rig.device.fault(kind, fraction=0.3)
        wait_until(lambda: count() >= before + 5)  # noqa: B023 - called at once
        rig.device.heal()
        rig.await_more()
    assert StrainStatus.RESYNCHRONISED in rig.recorder.status()
    lost = rig.health.lost_samples
    rig.device.fault('stale', 0.4)  # the box repeats old records, which must be dropped
    wait_until(lambda: rig.health.lost_samples > lost)
    rig.client.close()
    check_samples(rig, divisor(way))


@BOTH
def test_what_the_box_reports_is_in_the_status_and_in_words(rig, way):
    for kind, bit, word in (
        ('status', StrainStatus.DEVICE_ERROR, 0x80000040),
        ('saturate', StrainStatus.SATURATED, 0x80020000),
        ('stuck', StrainStatus.STUCK, 0),
    ):
        since = len(rig.recorder.take())
        rig.device.fault(kind)
        wait_until(lambda: bit in rig.recorder.status(since))  # noqa: B023 - called at once
        words = format_status(word, is_axia=False)
        assert rig.health.device_status == (', '.join(words) or None)
        assert bit in rig.health.status
        rig.await_more()  # samples still arrive during the fault
        rig.device.heal()
        wait_until(lambda: bit not in rig.health.status)  # noqa: B023 - called at once
        assert rig.health.device_status is None
        if kind == 'status':  # this fault does not change the values
            check_samples(rig, divisor(way), is_running=True)


@BOTH
def test_a_box_that_falls_silent_is_noticed_and_comes_back(rig, way):
    for kind in ('mute', 'unplug'):
        rig.device.fault(kind)
        wait_until(lambda: not rig.health.is_connected)
        assert rig.health.last_error
        before, since = rig.health, len(rig.recorder.take())
        rig.device.heal()
        wait_until(lambda: len(rig.recorder.take()) > since + 5)  # noqa: B023 - called at once
        assert StrainStatus.RECONNECTED in rig.recorder.take()[since].status
        assert rig.health.reconnects > before.reconnects
        assert rig.health.lost_samples > before.lost_samples
    rig.client.close()
    check_samples(
        rig, divisor(way)
    )  # the missing samples are counted, as the box's counter went on


@BOTH
@pytest.mark.parametrize('away_s', [0.01, 0.5])
def test_a_restarted_box_gets_its_settings_again(rig, way, away_s):
    since = len(rig.recorder.take())
    rig.device.fault('restart', away_s)
    wait_until(lambda: StrainStatus.RECONNECTED in rig.recorder.status(since))
    rig.await_more()
    assert rig.device.read_settings()['comrdtrate'] == way[0]
    assert rig.device.read_settings()['setuserfilter'] == 6
    assert rig.health.restarts == 1
    assert rig.health.rate_hz == INTERNAL_HZ / divisor(way)
    for before, after in pairwise(rig.recorder.take()):
        assert after.sequence == before.sequence + len(before.tension_n) + after.lost_before
        assert after.stamp_ns > before.stamp_ns


def test_pounds_and_another_axis_become_newtons():
    box = NetFtBox(
        lambda t: np.full(t.shape, 5.0),
        axis='fx',
        force_unit='lbf',
        counts_per_force=123_457,
    )
    with NetFtDevice(box) as device:
        recorder = Recorder()
        config = configure(device, SLOW, axis='fx', scale=-1.0)
        with NetFtClient(config, recorder, time.time_ns):
            wait_until(lambda: recorder.samples() > 50)
    tension_n = np.concatenate([block.tension_n for block in recorder.take()])
    wrench = np.concatenate([block.wrench for block in recorder.take()])
    assert wrench.shape == (len(tension_n), 6)
    np.testing.assert_allclose(tension_n.mean(), -5.0, atol=0.02)
    np.testing.assert_array_equal(tension_n, -wrench[:, 0])


def test_a_box_that_is_not_there_is_an_error_with_a_remedy():
    with NetFtDevice(NetFtBox(ramp)) as device:
        config = configure(device, SLOW)
    with pytest.raises(LinkError, match='check'):
        NetFtClient(config, print, time.time_ns).open()


def test_a_rate_above_that_of_the_box_is_refused():
    with NetFtDevice(NetFtBox(ramp)) as device:
        client = NetFtClient(configure(device, (8000.0, 10)), print, time.time_ns)
        with pytest.raises(LinkError, match='8000 Hz'):
            client.open()
        client.close()


def test_settings_that_are_right_are_not_written_again():
    box = NetFtBox(ramp)
    written = []
    answer = box.answer
    box.answer = lambda path: (written.append(path) if '.cgi' in path else None) or answer(path)
    with NetFtDevice(box) as device:
        for expected in (2, 2):  # the first client writes two pages, the second client none
            recorder = Recorder()
            with NetFtClient(configure(device, FAST), recorder, time.time_ns):
                wait_until(lambda recorder=recorder: recorder.samples() > 10)
            assert len(written) == expected


@pytest.mark.parametrize(
    ('setting', 'named'),
    [
        ('comrdte', 'RDT'),
        ('comrdtrate', r'2000 Hz.* 1000\.00 Hz'),
        ('setuserfilter', '18 Hz.* 0 Hz'),
        ('cgi', 'setting'),
    ],
)
def test_a_setting_that_the_box_does_not_take_is_told(setting, named):
    box = NetFtBox(ramp)
    box.settings['comrdte'] = 0
    answer = box.answer
    box.answer = lambda path: answer(path.replace(setting, 'other'))
    with NetFtDevice(box) as device, pytest.raises(LinkError, match=named):
        NetFtClient(configure(device, FAST), print, time.time_ns).open()
