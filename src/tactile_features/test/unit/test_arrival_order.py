# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The same samples and events give the same windows, in whatever order and grouping they come."""

from collections import Counter
import dataclasses
from itertools import pairwise
from random import Random
from typing import NamedTuple

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np

from tactile_features import (
    FeatureConfig,
    Outcome,
    spec_for,
    TrialEvent,
    TrialFeatureExtractor,
    WantedFeatures,
)
from tactile_ros.strain import StrainBlock, StrainStatus

S = 1_000_000_000
PERIOD_NS = 50_000_000
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
        partial_samples=(30, 40) if texture_samples == 45 else (),
        texture_crop_start_s=draw(st.sampled_from([0.0, 0.2])),
        texture_crop_end_s=draw(st.sampled_from([0.0, 0.1])),
        stiffness_settle_s=draw(st.sampled_from([0.0, 0.2])),
        stiffness_crop_end_s=0.1,
        stiffness_min_s=draw(st.sampled_from([0.2, 1.0])),
        max_gap_samples=draw(st.sampled_from([0, 2])),
        buffer_s=60.0,
        samples_timeout_s=draw(st.sampled_from([0.5, 5.0])),
        accept_unknown_stamp_error=draw(st.booleans()),
    )


def make_stream(random, count=160):
    """Samples from 0 s to about 8 s with losses, jitter, bad status, a restart, a clock step."""

    def some(most):
        return [random.randrange(1, count) for _ in range(random.randint(0, most))]

    lost = {n for start in some(3) for n in range(start, start + random.randint(1, 4))}
    jitter_ns = {n: random.randint(-80_000_000, 80_000_000) for n in some(3)}
    status_at = {}
    for start in some(3):
        bit = random.choice(
            [
                StrainStatus.STUCK,
                StrainStatus.STUCK,
                StrainStatus.RECONNECTED,
                StrainStatus.RESYNCHRONISED,
            ]
        )
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
    """A few trials of a few phases each, in order of time, some without an end."""
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
    """Blocks of samples that one block can express, ended wherever asked for."""
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


def extract(config, inputs, wanted=()):
    """The windows of finished phases, and those that came while a glide went on."""
    extractor = TrialFeatureExtractor(config, wanted)
    windows = []
    for item in inputs:
        add = extractor.add_block if isinstance(item, StrainBlock) else extractor.add_event
        windows += add(item)
    windows += extractor.finish()
    return [w for w in windows if not w.partial], [w for w in windows if w.partial]


def mix(random, blocks, events):
    """Both in their order, interleaved at random."""
    queues = [list(reversed(blocks)), list(reversed(events))]
    mixed = []
    while any(queues):
        bias = random.choice([1, 5, 20])
        queue = queues[random.choices([0, 1], [bias, 1])[0]]
        if queue:
            mixed.append(queue.pop())
    return mixed


outcomes: Counter[Outcome] = Counter()
partial_outcomes: Counter[Outcome] = Counter()


# Which outcomes the examples meet is asserted below, so the examples are always the same.
@settings(max_examples=100, deadline=None, derandomize=True)
@given(configs(), st.integers(0, 2**32 - 1))
def check_interleaving_and_grouping(config, seed):
    random = Random(seed)
    samples, events = make_stream(random), make_events(random)
    expected = extract(config, [*events, *group(samples, lambda: True)])
    finished = [
        begun
        for begun, end in pairwise(events)
        if begun.trial_id == end.trial_id and begun != end and begun.phase in ('glide', 'hold')
    ]
    assert [w.trial_id for w in expected[0]] == [begun.trial_id for begun in finished]

    chance = random.choice([0.0, 0.1, 0.5])
    blocks = group(samples, lambda: random.random() < chance)
    assert extract(config, [*blocks, *events]) == expected

    assert extract(config, mix(random, blocks, events)) == expected
    outcomes.update(w.outcome for w in expected[0])
    partial_outcomes.update(w.outcome for w in expected[1])


def test_any_interleaving_and_grouping_gives_the_same_bits():
    outcomes.clear()
    partial_outcomes.clear()
    check_interleaving_and_grouping()
    assert set(outcomes) == set(Outcome), f'the examples did not meet every outcome: {outcomes}'
    expected_partial = {Outcome.OK, Outcome.GAP, Outcome.BAD_SIGNAL, Outcome.BAD_TIME}
    assert set(partial_outcomes) == expected_partial, partial_outcomes


GLIDES = ('texture_spectrum', 'texture_spectrum', 'glide_waveform', 'texture_spatial')
HOLDS = ('stiffness_regression', 'stiffness_relaxation', 'hold_waveform')


@st.composite
def wanted_features(draw):
    """Several specifications, of which some differ in one parameter alone."""
    wanted = []
    for _ in range(draw(st.integers(2, 5))):
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
        )
        task = draw(st.sampled_from(['texture', 'texture', 'stiffness']))
        has_parts = task == 'texture' and glide == 'texture_spectrum'
        counts = [30, 40][: (texture_samples > 30) * draw(st.integers(0, 2))] if has_parts else []
        wanted.append(WantedFeatures(spec_for(task, config), tuple(counts)))
    return wanted


def of_digest(windows, digest):
    return [w for w in windows if w.specification_digest == digest]


shared: Counter[tuple[bool, Outcome]] = Counter()


@settings(max_examples=200, deadline=None, derandomize=True)
@given(configs(), wanted_features(), st.integers(0, 2**32 - 1))
def check_each_specification_is_as_if_alone(config, wanted, seed):
    random = Random(seed)
    samples, events = make_stream(random), make_events(random)
    chance = random.choice([0.0, 0.1, 0.5])
    blocks = group(samples, lambda: random.random() < chance)
    together = extract(config, mix(random, blocks, events), wanted)
    assert together[0] == extract(config, [*events, *blocks], wanted)[0]
    extractor = TrialFeatureExtractor(config, wanted)
    assert {spec.digest for spec in extractor.specifications} >= {w.spec.digest for w in wanted}
    alone_inputs = mix(random, group(samples, lambda: random.random() < 0.3), events)
    for each in extractor.wanted:
        if each.spec.digest not in {w.spec.digest for w in wanted}:
            continue
        alone = extract(config, alone_inputs, [each])
        for mine, of_alone in zip(together, alone, strict=True):
            found = of_digest(mine, each.spec.digest)
            assert found == of_digest(of_alone, each.spec.digest)
            shared.update((w.partial, w.outcome) for w in found)


def test_each_of_several_specifications_gives_the_bits_that_it_gives_alone():
    shared.clear()
    check_each_specification_is_as_if_alone()
    assert {outcome for partial, outcome in shared if not partial} == set(Outcome), shared
    assert {outcome for partial, outcome in shared if partial} >= {Outcome.OK, Outcome.GAP}, shared


@settings(max_examples=25, deadline=None)
@given(configs(), st.integers(0, 2**32 - 1))
def test_own_features_wanted_by_name_are_those_without_anything_wanted(config, seed):
    random = Random(seed)
    inputs = mix(random, group(make_stream(random), lambda: True), make_events(random))
    own = TrialFeatureExtractor(config).wanted
    assert [w.spec for w in own] == [spec_for(task, config) for task in ('texture', 'stiffness')]
    assert extract(config, inputs, own) == extract(config, inputs)


def make_stream_of_a_constant(count, first_ns=0):
    return [
        StrainBlock(first_ns + n * PERIOD_NS, n + 1, PERIOD_NS, np.array([1.0]), stamp_error_s=0.0)
        for n in range(count)
    ]


def test_own_partial_windows_do_not_depend_on_the_rates_of_the_others():
    config = FeatureConfig(rate_hz=20.0, texture_samples=45, partial_samples=(30,))
    wanted = [
        WantedFeatures(spec_for('texture', FeatureConfig(rate_hz=rate_hz, texture_samples=count)))
        for rate_hz, count in ((25.0, 45), (20.0, 10))
    ]
    together = TrialFeatureExtractor(config, wanted)
    alone = TrialFeatureExtractor(config, wanted[:1])
    digest = wanted[0].spec.digest
    (mine,) = [each for each in together.wanted if each.spec.digest == digest]
    (of_alone,) = [each for each in alone.wanted if each.spec.digest == digest]
    assert mine == of_alone
    assert mine.partial_samples == (30,)


def test_a_short_phase_is_called_short_although_another_still_waits_at_the_end():
    config = FeatureConfig(rate_hz=20.0, texture_samples=45, texture_crop_start_s=0.0)
    short = dataclasses.replace(config, texture_samples=10)
    events = [
        TrialEvent(stamp_ns, f't{trial}', 's1', 'texture', 'flexion', '', phase)
        for trial, phase, stamp_ns in (
            (1, 'glide', 0),
            (1, 'done', 1 * S),
            (2, 'glide', 2 * S),
            (2, 'done', 2 * S + PERIOD_NS),
        )
    ]
    wanted = [WantedFeatures(spec_for('texture', each)) for each in (config, short)]
    windows, _ = extract(config, [*make_stream_of_a_constant(5), *events], wanted)
    first, second = (of_digest(windows, each.spec.digest) for each in wanted)
    assert [w.outcome for w in first] == [Outcome.TOO_SHORT] * 2
    assert [w.outcome for w in second] == [Outcome.GAP, Outcome.TOO_SHORT]
