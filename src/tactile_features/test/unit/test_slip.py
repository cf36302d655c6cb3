# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Falls of tension in a synthetic grip: which are slips, when, and which are none."""

import dataclasses
from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from trials import make_block

from tactile_features.errors import FeatureError
from tactile_features.slip import SlipConfig, SlipDetector
from tactile_ros.strain import StrainStatus

CONFIG = SlipConfig()
PERIOD_NS = 16_666_667
NOISE_N = 0.004
START = 3_000  # the first sequence number: a stream need not begin at 0
AT = 600


def grip(seconds=12.0, seed=0, rate_hz=60.0, noise_n=NOISE_N):
    """A hold that creeps as the paper's does, with white noise."""
    time_s = np.arange(round(seconds * rate_hz)) / rate_hz
    noise = np.random.default_rng(seed).normal(0.0, noise_n, len(time_s))
    return 8.0 + 4.7 * np.exp(-time_s / 3.8) + noise


def slipping(at=AT, fall_n=0.04, **options):
    tension_n = grip(**options)
    tension_n[at:] -= fall_n
    return tension_n


def block(tension_n, first=0, status=0, period_ns=PERIOD_NS):
    return make_block(tension_n, START + first, period_ns, status=status)


def detect(*blocks, config=CONFIG):
    detector = SlipDetector(config)
    return [slip for item in blocks for slip in detector.add(item)]


def test_a_sudden_fall_is_a_slip_at_its_sample():
    (slip,) = detect(block(slipping()))
    assert AT - 2 <= slip.onset_ns / PERIOD_NS - START <= AT  # before the first that fell
    assert 0 <= slip.stamp_ns - slip.onset_ns <= 4 * PERIOD_NS
    assert slip.statistic > 1.0
    assert slip.tension_n == pytest.approx(8.0 + 4.7 * np.exp(-10 / 3.8) - 0.04, abs=0.02)
    # The noise is that of the stream.
    assert len(detect(block(slipping(noise_n=0.04, fall_n=0.4)))) == 1


@pytest.mark.parametrize(('first', 'is_simulated'), [(0, True), (AT - 5, True), (AT + 99, False)])
def test_a_slip_of_simulated_samples_says_so(first, is_simulated):
    before, after = np.split(slipping(), [first])
    blocks = [block(before)] if first else []
    (slip,) = detect(*blocks, block(after, first, status=StrainStatus.SIMULATED))
    assert slip.simulated is is_simulated


def around(first, last, status=None):
    """A slip whose samples from first to last are lost, or marked."""
    before, between, after = np.split(slipping(), [first, last])
    marked = [] if status is None else [block(between + 7.0, first, status)]
    return [block(before), *marked, block(after - 0.5, last)]


NOT_FINITE = np.where(np.arange(len(slipping())) == AT - 1, np.nan, slipping())
# Slack, pulled tight within half a second, and held.
PULLED = np.concatenate([np.zeros(300), np.linspace(0.0, 12.7, 30), grip(seconds=10.0)])
WANDER = np.zeros(6_000)
for i, push in enumerate(np.random.default_rng(1).normal(0.0, NOISE_N, len(WANDER))):
    WANDER[i] = 0.9 * WANDER[i - 1] + push


@pytest.mark.parametrize(
    ('blocks', 'config'),
    [
        ([block(grip(seconds=100.0))], CONFIG),
        ([block(grip(seconds=100.0) + WANDER)], CONFIG),
        ([block(slipping(fall_n=-0.04))], CONFIG),
        ([block(slipping(fall_n=0.004))], CONFIG),
        ([block(slipping(noise_n=0.04))], CONFIG),
        ([block(slipping())], dataclasses.replace(CONFIG, min_tension_n=9.0)),
        (around(AT - 5, AT + 5), CONFIG),
        (around(AT - 5, AT + 5, StrainStatus.SATURATED), CONFIG),
        (around(AT - 5, AT + 5, StrainStatus.STUCK), CONFIG),
        ([block(NOT_FINITE)], CONFIG),
        ([block(PULLED + np.random.default_rng(2).normal(0.0, NOISE_N, len(PULLED)))], CONFIG),
    ],
    ids=[
        'creep',
        'noise that is not white',
        'rise',
        'small',
        'in loud noise',
        'least tension',
        'behind a gap',
        'saturated',
        'stuck',
        'no number',
        'gripping',
    ],
)
def test_what_is_no_slip(blocks, config):
    assert detect(*blocks, config=config) == []


def test_falls_that_were_missed_are_not_learned_as_noise():
    tension_n = slipping(at=1140, fall_n=0.035, seconds=20.0)
    for at in range(100, 1100, 15):
        tension_n[at:] -= 0.015
    (slip,) = detect(block(tension_n), config=SlipConfig(threshold=6.0))
    assert slip.onset_ns / PERIOD_NS - START == pytest.approx(1139, abs=2)


def test_a_clock_set_back_begins_anew_and_forgets_the_noise():
    second = block(slipping()[:-90])
    alone = detect(second)
    assert len(alone) == 1
    assert detect(block(grip(noise_n=0.04)), second) == alone


FAST = {'at': 2500, 'fall_n': 0.02, 'seconds': 3.0, 'rate_hz': 1000.0}


@pytest.mark.parametrize(
    ('tension_n', 'period_ns', 'at'),
    [(slipping(), PERIOD_NS, AT), (slipping(**FAST), 1_000_000, 2500)],
    ids=['60 Hz', '1 kHz'],
)
@given(data=st.data())
@settings(max_examples=6, deadline=None)
def test_grouping_does_not_matter(tension_n, period_ns, at, data):
    count = len(tension_n)
    cuts = data.draw(st.lists(st.integers(1, count - 1), max_size=30, unique=True))
    pieces = [
        block(tension_n[a:b], a, period_ns=period_ns)
        for a, b in pairwise([0, *sorted(cuts), count])
    ]
    whole = detect(block(tension_n, period_ns=period_ns))
    assert detect(*pieces) == whole
    (slip,) = whole
    assert slip.onset_ns / period_ns - START == pytest.approx(at, abs=9)


@pytest.mark.parametrize('rate_hz', [20.0, 60.0, 59.94, 333.0, 1000.0, 7000.0])
def test_the_rate_is_that_of_the_blocks(rate_hz):
    detector = SlipDetector(CONFIG)
    detector.add(block(grip(1.0, rate_hz=rate_hz), period_ns=round(1e9 / rate_hz)))
    assert detector.rate_hz == pytest.approx(rate_hz, rel=1e-7)
    assert (detector.rate_hz == rate_hz) is (rate_hz != 59.94)  # the period is rounded


def test_another_rate_begins_anew():
    detector = SlipDetector(CONFIG)
    assert len(detector.add(block(slipping()))) == 1
    # Behind the first stream in time and number, so that only the rate begins it anew.
    second = block(slipping(**FAST), 20_000_000, period_ns=1_000_000)
    alone = SlipDetector(CONFIG).add(second)
    assert detector.add(second) == alone
    assert len(alone) == 1
    assert detector.rate_hz == 1000.0
    # Slower than 20 Hz, nothing is found.
    assert detector.add(block(slipping(), 20_000_000, period_ns=100_000_000)) == []
    assert detector.rate_hz == 10.0


def test_a_single_sample_without_a_period_has_the_rate_of_those_before():
    tension_n = slipping()
    pieces = [block(tension_n[i : i + 1], i) for i in range(len(tension_n))]
    without = [dataclasses.replace(piece, period_ns=0) for piece in pieces[1:]]
    assert detect(pieces[0], *without) == detect(block(tension_n))
    assert detect(*without) == []


def test_a_value_out_of_range_is_refused():
    with pytest.raises(FeatureError, match='threshold is 1'):
        SlipConfig(threshold=1.0)
