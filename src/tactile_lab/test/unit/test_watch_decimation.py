# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live plot draws fewer points than samples, but shows every spike of the tension."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_lab.watch.finger import BUCKET_NS, Decimator
from tactile_ros.strain import StrainBlock

RATES_HZ = st.sampled_from([1.0, 60.0, 150.0, 199.0, 200.0, 201.0, 1000.0, 7000.0])


def blocks_of(tension_n, period_ns, cuts, *, start_ns=0, lost=()):
    """Return blocks that end at ``cuts``, without the samples whose index is in ``lost``."""
    stamps = start_ns + np.arange(len(tension_n)) * period_ns
    ends = sorted({*cuts, *lost, *(i + 1 for i in lost), len(tension_n)} - {0})
    blocks, begin = [], 0
    for end in ends:
        if begin not in lost:
            values = np.array(tension_n[begin:end])
            blocks.append(StrainBlock(int(stamps[begin]), begin, period_ns, values))
        begin = end
    return blocks


def points_of(blocks):
    decimator = Decimator()
    points = [point for block in blocks for point in decimator.add(block)]
    return points + decimator._close()


@st.composite
def signals(draw):
    # Hypothesis draws a string of bytes much faster than a list of numbers.
    tension_n = np.frombuffer(draw(st.binary(min_size=1, max_size=150)), np.int8).tolist()
    count = len(tension_n)
    cuts = draw(st.lists(st.integers(1, count), max_size=20))
    start_ns = draw(st.integers(0, 3 * BUCKET_NS))
    return [float(t) for t in tension_n], round(1e9 / draw(RATES_HZ)), cuts, start_ns


@given(signals())
def test_points_do_not_depend_on_blocks_and_keep_the_extremes_of_each_bucket(signal):
    tension_n, period_ns, cuts, start_ns = signal
    points = points_of(blocks_of(tension_n, period_ns, cuts, start_ns=start_ns))
    assert points == points_of(blocks_of(tension_n, period_ns, [], start_ns=start_ns))
    stamps = [p.stamp_ns for p in points]
    assert stamps == sorted(set(stamps))
    samples = {start_ns + i * period_ns: t for i, t in enumerate(tension_n)}
    assert all(samples[p.stamp_ns] == p.tension_n for p in points)
    buckets = {}
    for stamp_ns, tension in samples.items():
        buckets.setdefault(stamp_ns // BUCKET_NS, []).append(tension)
    for bucket, expected in buckets.items():
        kept = [p.tension_n for p in points if p.stamp_ns // BUCKET_NS == bucket]
        assert len(kept) <= 2
        assert (min(kept), max(kept)) == (min(expected), max(expected))


@given(signals(), st.sets(st.integers(0, 149), max_size=5))
def test_line_has_a_gap_wherever_samples_are_lost(signal, lost):
    tension_n, period_ns, cuts, _ = signal
    lost = {i for i in lost if 0 < i < len(tension_n) - 1}
    points = points_of(blocks_of(tension_n, period_ns, cuts, lost=lost))
    runs = sum(i - 1 not in lost for i in lost)
    assert sum(p.tension_n is None for p in points) == runs
    stamps = [p.stamp_ns for p in points]
    assert stamps == sorted(stamps)


def test_spike_of_one_sample_at_7_khz_is_kept():
    tension_n = [math.sin(i / 500) for i in range(7000)]
    tension_n[3456] = 25.0
    points = points_of(blocks_of(tension_n, round(1e9 / 7000), range(7, 7000, 7)))
    assert max(p.tension_n for p in points) == 25.0
    assert len(points) <= 202


def test_older_block_is_ignored():
    decimator = Decimator()
    new = StrainBlock(10**9, 60, 16_666_667, np.array([1.0]))
    assert len(decimator.add(new)) == 1
    assert decimator.add(StrainBlock(10**9 - 16_666_667, 59, 16_666_667, np.array([1.0]))) == []


@pytest.mark.parametrize('rate_hz', [60.0, 1000.0])
@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_line_has_a_gap_where_a_sample_is_nan(rate_hz, value):
    tension_n = [1.0, 2.0, 3.0] * 20
    tension_n[31] = value
    points = points_of(blocks_of(tension_n, round(1e9 / rate_hz), [10, 32, 40]))
    breaks = [p for p in points if p.tension_n is None]
    assert [p.stamp_ns for p in breaks] == [31 * round(1e9 / rate_hz)]
    assert {p.tension_n for p in points} - {None} <= {1.0, 2.0, 3.0}
    assert [p.stamp_ns for p in points] == sorted(p.stamp_ns for p in points)
