# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import numpy as np
import pytest

from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver import TendonSensorConfig
from tendon_sensor_driver.tare import Tare, TareError

CONFIG = TendonSensorConfig(tare_samples=50)
PERIOD_NS = CONFIG.period_ns
NOW_NS = 100 * PERIOD_NS


def make_block(tension_n, first=0, status=StrainStatus.OK, wrench=None):
    return StrainBlock(
        stamp_ns=first * PERIOD_NS,
        sequence=first,
        period_ns=PERIOD_NS,
        tension_n=np.asarray(tension_n, float),
        status=status,
        wrench=wrench,
    )


def feed(tare, tension_n, **options):
    """Add samples to the tare, in blocks of seven. The last sample is at the time NOW_NS."""
    start = 100 - len(tension_n)
    for i in range(0, len(tension_n), 7):
        tare.apply(make_block(tension_n[i : i + 7], start + i, **options))


def noise(mean_n=0.3, count=80):
    return np.random.default_rng(2).normal(mean_n, 0.01, count)


def test_the_mean_of_the_last_samples_is_taken_off_from_then_on():
    tare = Tare(CONFIG)
    tension_n = noise()
    feed(tare, tension_n)
    assert tare.apply(make_block([0.7], 100)).tension_n == [0.7]
    tension_n = np.append(tension_n, 0.7)[-50:]
    tension_n[-1] = 0.3
    feed(tare, tension_n)
    value = tare.measure(NOW_NS)
    assert value.tare_n == pytest.approx(np.mean(tension_n), rel=1e-12)
    assert value.spread_n == pytest.approx(np.std(tension_n, ddof=1), rel=1e-12)
    assert (value.samples, value.stamp_ns) == (50, NOW_NS)
    assert tare.apply(make_block([0.7])).tension_n == [0.7 - value.tare_n]
    cleared = tare.clear(NOW_NS + 5)
    assert (cleared.samples, cleared.tare_n, cleared.stamp_ns) == (0, 0.0, NOW_NS + 5)
    assert tare.apply(make_block([0.7])).tension_n == [0.7]


@pytest.mark.parametrize(
    ('tension_n', 'code', 'named'),
    [
        ([], 'few', '0 of 50'),
        (noise(count=49), 'few', '49 of 50'),
        (noise(2.5), 'loaded', 'tare_limit_n'),
        (noise(-2.5), 'loaded', '-2.50 N'),
        (noise() + np.linspace(0, 0.3, 80), 'moving', 'tare_change_n'),
        (noise() + 0.3 * (np.arange(80) % 2), 'noisy', 'tare_spread_n'),
    ],
)
def test_it_is_refused_with_the_reason_and_changes_nothing(tension_n, code, named):
    tare = Tare(CONFIG)
    assert not tare.note_restart(NOW_NS)
    feed(tare, noise(0.2))
    assert tare.measure(NOW_NS).samples == 50
    assert tare.note_restart(NOW_NS)  # True, because it has cleared a tare
    assert tare.value.samples == 0
    feed(tare, tension_n)
    with pytest.raises(TareError, match=named) as refusal:
        tare.measure(NOW_NS)
    assert refusal.value.code == code
    assert tare.value.samples == 0


@pytest.mark.parametrize('bad', ['SATURATED', 'STUCK', 'DEVICE_ERROR'])
def test_bad_samples_are_no_zero(bad):
    tare = Tare(CONFIG)
    feed(tare, noise(), status=StrainStatus[bad] | StrainStatus.HOST_TIME)
    with pytest.raises(TareError, match=bad.lower()) as refusal:
        tare.measure(NOW_NS)
    assert refusal.value.code == 'marked'


def test_load_is_judged_without_the_tare_so_that_tares_do_not_add_up():
    tare = Tare(CONFIG)
    feed(tare, noise(1.5))
    tare.measure(NOW_NS)
    feed(tare, noise(2.5))
    with pytest.raises(TareError) as refusal:
        tare.measure(NOW_NS)
    assert refusal.value.code == 'loaded'
    assert tare.value.tare_n == pytest.approx(1.5, abs=0.01)


def test_the_drift_is_seen_while_a_tare_would_be_accepted():
    tare = Tare(CONFIG)
    feed(tare, noise(0.3))
    assert tare.compute_drift(NOW_NS) is None
    tare.measure(NOW_NS)
    feed(tare, noise(0.35))
    assert tare.compute_drift(NOW_NS) == pytest.approx(0.05, abs=1e-9)
    feed(tare, noise(5.0))
    assert tare.compute_drift(NOW_NS) is None


def test_all_six_axes_are_tared_with_the_tension():
    tare = Tare(CONFIG)
    wrench = np.arange(6.0) + np.zeros((7, 6))
    for first in range(0, 98, 7):
        tare.apply(make_block(np.full(7, 0.2), first, wrench=wrench))
    tare.measure(NOW_NS)
    block = tare.apply(make_block([0.5], wrench=np.arange(6.0)[None] + 1.0))
    assert block.wrench.tolist() == [[1.0] * 6]


def test_it_keeps_no_more_than_it_needs():
    tare = Tare(dataclasses.replace(CONFIG, tare_samples=10))
    for first in range(0, 7000, 7):
        tare.apply(make_block(np.zeros(7), first))
    assert sum(len(block.tension_n) for block in tare._blocks) <= 16


@pytest.mark.parametrize('status', ['RECONNECTED', 'RESTARTED', 'CLOCK_STEP'])
def test_samples_from_before_a_break_make_no_tare(status):
    tare = Tare(CONFIG)
    feed(tare, noise())
    tare.apply(make_block([0.3], 100, StrainStatus[status]))
    with pytest.raises(TareError, match='1 of 50') as refusal:
        tare.measure(NOW_NS + PERIOD_NS)
    assert refusal.value.code == 'few'
    for i in range(49):
        tare.apply(make_block([0.4], 101 + i))
    assert tare.measure(NOW_NS + 50 * PERIOD_NS).tare_n == pytest.approx(0.398)


@pytest.mark.parametrize(('silent_s', 'is_taken'), [(0.4, True), (0.6, False), (600.0, False)])
def test_samples_from_before_a_silence_make_no_tare(silent_s, is_taken):
    tare = Tare(CONFIG)
    feed(tare, noise())
    first = 100 + round(silent_s * CONFIG.rate_hz)
    tare.apply(make_block([0.3], first))
    now_ns = (first + 1) * PERIOD_NS
    if is_taken:
        assert tare.measure(now_ns).samples == 50
        with pytest.raises(TareError, match=r'0\.6 s') as refusal:
            tare.measure(now_ns + 600_000_000)
        assert refusal.value.code == 'old'
    else:
        with pytest.raises(TareError, match=f'{silent_s:.1f} s') as refusal:
            tare.measure(now_ns)
        assert refusal.value.code == 'few'
