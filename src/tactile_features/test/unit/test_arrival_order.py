# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feature windows do not depend on the order and grouping in which samples and events arrive."""

from collections import Counter
import dataclasses
from itertools import pairwise
from random import Random
from typing import NamedTuple

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from trials import event, extract, make_block, S

from tactile_features import (
    FeatureConfig,
    spec_for,
    TrialEvent,
    TrialFeatureExtractor,
    WindowOutcome,
)
from tactile_features.feature_sets.registry import PHASE_OF_TASK
from tactile_ros.strain import StrainBlock, StrainStatus

PERIOD_NS = 50_000_000
BITS = [*[StrainStatus.STUCK] * 2, StrainStatus.RECONNECTED, StrainStatus.RESYNCHRONISED]
PHASES = ['approach', 'contact', 'glide', 'hold', 'release', 'done', 'aborted']


class Sample(NamedTuple):
    stamp_ns: int
    sequence: int
    tension_n: float
    status: int
    lost_before: int
    stamp_error_s: float


@st.composite
def configs(draw):
    texture_samples = draw(st.sampled_from([2, 10, 21, 45, 45]))
    return FeatureConfig(
        rate_hz=20.0,
        texture_samples=texture_samples,
        texture_crop_start_s=draw(st.sampled_from([0.0, 0.2])),
        texture_crop_end_s=draw(st.sampled_from([0.0, 0.1])),
        stiffness_settle_s=draw(st.sampled_from([0.0, 0.2])),
        stiffness_crop_end_s=0.1,
        stiffness_min_s=draw(st.sampled_from([0.2, 1.0])),
        max_gap_samples=draw(st.sampled_from([0, 2])),
        buffer_s=60.0,
        samples_timeout_s=draw(st.sampled_from([0.5, 5.0])),
        accept_unknown_stamp_error=draw(st.booleans()),
        early_windows=draw(st.booleans()),
    )


def make_stream(random, count=160):
    """Return samples from 0 s to about 8 s, with random faults.

    The faults are losses, jitter, bad status, a restart and a step of the clock.
    """

    def some(most):
        return [random.randrange(1, count) for _ in range(random.randint(0, most))]

    lost = {n for start in some(3) for n in range(start, start + random.randint(1, 4))}
    jitter_ns = {n: random.randint(-80_000_000, 80_000_000) for n in some(3)}
    status_at = {}
    for start in some(3):
        bit = random.choice(BITS)
        status_at.update(dict.fromkeys(range(start, start + random.randint(1, 20)), bit))
    error_at = {}
    for start in some(2):
        error_s = random.choice([-1.0, 0.0, 0.5])
        error_at.update(dict.fromkeys(range(start, start + random.randint(1, 20)), error_s))
    step_at = random.choice([None, None, random.randrange(1, count)])
    step_ns = random.choice([-900_000_000, -200_000_000, 200_000_000, 5 * S])
    restart_at = random.choice([None, None, random.randrange(1, count)])
    is_constant = random.random() < 0.2
    samples, sequence, lost_before = [], 0, 0
    for n in range(count):
        sequence = 0 if n == restart_at else sequence + 1
        if n in lost:
            lost_before += 1
            continue
        stamp_ns = n * PERIOD_NS + jitter_ns.get(n, 0)
        status = status_at.get(n, 0)
        if step_at is not None and n >= step_at:
            stamp_ns += step_ns
            status |= StrainStatus.CLOCK_STEP if n == step_at else 0
        tension_n = 2.0 if is_constant else random.gauss(5.0, 1.0)
        error_s = error_at.get(n, 0.001)
        samples.append(Sample(stamp_ns, sequence, tension_n, status, lost_before, error_s))
        lost_before = 0
    return samples


def make_events(random):
    """Return the events of a few trials, in order of time; some trials have no end."""
    resolution_ns = random.choice([1, PERIOD_NS])
    trial, stamp_ns = 0, 0
    events = []
    for _ in range(random.randint(3, 9)):
        trial += random.random() < 0.2
        stamp_ns += random.randrange(0, 2 * S) // resolution_ns * resolution_ns
        phase = random.choice([*PHASES, 'glide', 'glide', 'hold', 'hold'])
        events.append(TrialEvent(stamp_ns, f't{trial}', 's1', 'texture', 'flexion', '', phase))
    return events


def group(samples, is_end_of_block):
    """Return the samples as blocks; ``is_end_of_block`` decides where a block ends."""
    blocks, i = [], 0
    while i < len(samples):
        first = samples[i]
        step_ns = PERIOD_NS
        if i + 1 < len(samples):
            step_ns = samples[i + 1].stamp_ns - first.stamp_ns
        j = i + 1
        while (
            j < len(samples)
            and not is_end_of_block()
            and samples[j].sequence == samples[j - 1].sequence + 1
            and samples[j].stamp_ns == first.stamp_ns + (j - i) * step_ns
            and samples[j].status == first.status
            and samples[j].stamp_error_s == first.stamp_error_s
        ):
            j += 1
        tension_n = np.array([s.tension_n for s in samples[i:j]])
        blocks.append(
            StrainBlock(
                first.stamp_ns,
                first.sequence,
                step_ns,
                tension_n,
                lost_before=first.lost_before,
                status=first.status,
                stamp_error_s=first.stamp_error_s,
            )
        )
        i = j
    return blocks


def mix(random, blocks, events):
    """Return blocks and events interleaved at random; each of the two stays in order."""
    queues = [list(reversed(blocks)), list(reversed(events))]
    mixed = []
    while any(queues):
        bias = random.choice([1, 5, 20])
        queue = queues[random.choices([0, 1], [bias, 1])[0]]
        if queue:
            mixed.append(queue.pop())
    return mixed


GLIDES = ('texture_spectrum', 'texture_spectrum', 'glide_waveform', 'texture_spatial')
HOLDS = ('stiffness_regression', 'stiffness_relaxation', 'hold_waveform')


@st.composite
def wanted_features(draw):
    """Generate a list of up to five feature specifications; some differ in one parameter only."""
    wanted = []
    for _ in range(draw(st.sampled_from([0, 0, 1, 2, 3, 5]))):
        texture_samples = draw(st.sampled_from([10, 45, 60]))
        glide = draw(st.sampled_from(GLIDES))
        config = FeatureConfig(
            rate_hz=draw(st.sampled_from([20.0, 20.0, 20.0, 25.0])),
            texture_features=glide,
            texture_samples=texture_samples,
            texture_crop_start_s=draw(st.sampled_from([0.0, 0.2])),
            stiffness_features=draw(st.sampled_from(HOLDS)),
            stiffness_settle_s=draw(st.sampled_from([0.0, 0.2])),
            stiffness_samples=draw(st.sampled_from([9, 30])),
            max_gap_samples=draw(st.sampled_from([0, 1, 2, 4])),
            early_windows=draw(st.booleans()),
        )
        task = draw(st.sampled_from(['texture', 'texture', 'stiffness']))
        wanted.append(spec_for(task, config))
    return wanted


def of_digests(windows, digests):
    return [w for w in windows if w.specification_digest in digests]


full_outcomes: Counter[WindowOutcome] = Counter()
early_outcomes: Counter[WindowOutcome] = Counter()


# A test below asserts which outcomes occur in the examples, so they must not be random.
@settings(max_examples=110, deadline=None, derandomize=True)
@given(configs(), wanted_features(), st.integers(0, 2**32 - 1))
def check_arrival(config, wanted, seed):
    random = Random(seed)
    samples, events = make_stream(random), make_events(random)
    chance = random.choice([0.0, 0.1, 0.5])
    single, blocks = group(samples, lambda: True), group(samples, lambda: random.random() < chance)
    expected = extract(config, *events, *single, wanted=wanted)
    computed = TrialFeatureExtractor(config, wanted).specifications
    digests = [spec.digest for spec in computed]

    def assert_same(windows, some):
        assert of_digests(windows, some) == of_digests(expected, some)

    for inputs in ([*blocks, *events], mix(random, blocks, events)):
        windows = extract(config, *inputs, wanted=wanted)
        for digest in digests:
            assert_same(windows, {digest})

    if not wanted:  # the default specifications, which can also be requested explicitly
        full = {s.digest: PHASE_OF_TASK[s.task] for s in computed if not s.is_early}
        finished = [
            begun.trial_id
            for begun, end in pairwise(events)
            if begun.trial_id == end.trial_id and begun != end and begun.phase in full.values()
        ]
        assert [w.trial_id for w in of_digests(expected, full)] == finished
        for digest in digests:
            assert_same(extract(config, *inputs, wanted=computed), {digest})
    asked = {spec.digest for spec in wanted}
    assert asked <= set(digests)
    for spec in computed:
        if spec.digest in asked:
            alone = extract(config, *mix(random, blocks, events), wanted=[spec])
            assert_same(alone, {spec.digest})
    early = {spec.digest for spec in computed if spec.is_early}
    for window in expected:
        counts = early_outcomes if window.specification_digest in early else full_outcomes
        counts[window.outcome] += 1


def test_any_arrival_gives_the_same_bits_and_each_specification_those_it_gives_alone():
    full_outcomes.clear()
    early_outcomes.clear()
    check_arrival()
    assert set(full_outcomes) == set(WindowOutcome), full_outcomes
    expected = {
        WindowOutcome.OK,
        WindowOutcome.GAP,
        WindowOutcome.BAD_SIGNAL,
        WindowOutcome.BAD_TIME,
        WindowOutcome.TOO_SHORT,
    }
    assert expected <= set(early_outcomes), early_outcomes


def test_early_windows_come_in_the_order_of_their_last_samples():
    config = FeatureConfig(rate_hz=20.0, texture_crop_start_s=0.0, early_windows=True)
    wanted = [
        spec_for('texture', dataclasses.replace(config, texture_samples=count))
        for count in (50, 30, 40, 35)
    ]
    samples = make_block(np.arange(60.0), 0, PERIOD_NS)
    windows = extract(config, event(0.0, 'glide'), samples, wanted=wanted)
    assert [w.sample_count for w in windows] == [30, 35, 40, 50]


def test_a_short_phase_is_called_short_although_another_still_waits_at_the_end():
    config = FeatureConfig(rate_hz=20.0, texture_samples=45, texture_crop_start_s=0.0)
    short = dataclasses.replace(config, texture_samples=10)
    times_s = {'t1': (0.0, 1.0), 't2': (2.0, 2.05)}
    events = [
        event(time_s, phase, trial)
        for trial, span in times_s.items()
        for time_s, phase in zip(span, ('glide', 'done'), strict=True)
    ]
    samples = make_block(np.ones(5), 1, PERIOD_NS, stamp_error_s=0.0)
    wanted = [spec_for('texture', each) for each in (config, short)]
    windows = extract(config, samples, *events, wanted=wanted)
    first, second = (of_digests(windows, {spec.digest}) for spec in wanted)
    assert [w.outcome for w in first] == [WindowOutcome.TOO_SHORT] * 2
    assert [w.outcome for w in second] == [WindowOutcome.GAP, WindowOutcome.TOO_SHORT]
