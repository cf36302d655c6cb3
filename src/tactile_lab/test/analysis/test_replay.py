# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import numpy as np
import pytest

from tactile_bags import BagWriter, TactileBag
from tactile_bags.errors import BagError
from tactile_bags.message_records import read_records
from tactile_bags.recorded_setup import recorded_features
from tactile_bags.replay import (
    compare,
    compare_with_recorded,
    first_sample_ns,
    replay_through_core,
    TactileResults,
)
from tactile_classifier import ModelSet
from tactile_ros.topics import EVENT

NAMES = ('one', 'other')


@pytest.fixture
def results(stiffness_bag, trained):
    with TactileBag(stiffness_bag) as bag:
        return replay_through_core(bag, ModelSet.load(trained), recorded_features(bag))


def changed(results, **fields):
    windows = list(results.windows)
    windows[3] = dataclasses.replace(windows[3], **fields)
    return TactileResults(windows, list(results.classifications))


def test_two_replays_are_equal_and_classify_each_trial(results, stiffness_bag, trained):
    assert len(results.windows) == len(results.classifications) == 15
    assert all(c.label for c in results.classifications)
    with TactileBag(stiffness_bag) as bag:
        again = replay_through_core(bag, ModelSet.load(trained), recorded_features(bag))
    comparison = compare(results, again, NAMES)
    assert comparison.is_equal
    assert comparison.window_count == 15


def test_a_missing_window_and_a_difference_in_the_last_bit_are_reported(results):
    fewer = TactileResults(results.windows[:-1], results.classifications)
    told = compare(results, fewer, NAMES).first_difference
    assert '15 feature windows in one, 14 in other' in told
    values = results.windows[3].values.copy()
    values[1] = np.nextafter(values[1], np.inf)
    comparison = compare(results, changed(results, values=values), NAMES)
    assert not comparison.is_equal
    assert results.windows[3].trial_id in comparison.first_difference
    assert 'values' in comparison.first_difference


def test_the_sign_of_a_zero_score_is_reported(results):
    def with_score(score):
        answers = [dataclasses.replace(results.classifications[0], scores=(1.0, score))]
        return TactileResults([], answers)

    assert compare(with_score(0.0), with_score(0.0), NAMES).is_equal
    assert 'scores' in compare(with_score(0.0), with_score(-0.0), NAMES).first_difference


def test_model_for_other_windows_gives_a_reason_for_each_window(stiffness_bag, trained):
    with TactileBag(stiffness_bag) as bag:
        recorded = recorded_features(bag)
        config = dataclasses.replace(recorded.config, stiffness_settle_s=1.0)
        other = dataclasses.replace(recorded, config=config)
        results = replay_through_core(bag, ModelSet.load(trained), other)
    assert len(results.classifications) == len(results.windows) == 15
    assert all('settle' in answer.reason for answer in results.classifications)


def test_unusable_feature_parameters_are_refused(stiffness_bag):
    with TactileBag(stiffness_bag) as bag:
        for values in ({'rate_hz': 'fast'}, {'rate_hz': -1.0}, [1], 'red'):
            bag.metadata['feature_config'] = values
            with pytest.raises(BagError, match='feature parameters'):
                recorded_features(bag)


def timed(results, end_ns, **made_at_ns):
    """Return results with times of computation long before the end of the recording.

    ``made_at_ns`` has other times, by ``_`` and the number of the result.
    """
    results = TactileResults(list(results.windows), list(results.classifications))
    for items in (results.windows, results.classifications):
        for i, item in enumerate(items):
            results.made_at_ns[id(item)] = made_at_ns.get(f'_{i}', end_ns - (20 - i) * 10**10)
    return results


def without(results, *places):
    left = [
        [x for i, x in enumerate(items) if i not in places]
        for items in (results.windows, results.classifications)
    ]
    return TactileResults(*left, results.made_at_ns)


def test_results_of_the_last_moment_need_not_be_recorded(results):
    end_ns = 10**18
    core = timed(results, end_ns, _13=end_ns - 2 * 10**8, _14=end_ns - 10**8)
    for places in ([14], [13, 14]):
        comparison = compare_with_recorded(without(core, *places), core, end_ns)
        assert comparison.is_equal, comparison
        assert comparison.window_count == 15 - len(places)
        assert f'{len(places)} feature windows and {len(places)} class' in comparison.left_out
        assert results.windows[14].trial_id in comparison.left_out
        assert 'could not be recorded' in comparison.left_out
        # A result was recorded, but the last samples from which it was computed were not.
        comparison = compare_with_recorded(core, without(core, *places), end_ns)
        assert comparison.is_equal
        assert 'last samples' in comparison.left_out


def test_missing_result_before_the_end_is_a_difference(results):
    end_ns = 10**18
    early = timed(results, end_ns)
    late = timed(results, end_ns, _13=end_ns - 2 * 10**8, _14=end_ns - 10**8)
    for core, place in ((early, 14), (early, 3), (late, 13), (late, 3)):
        comparison = compare_with_recorded(without(core, place), core, end_ns)
        assert not comparison.is_equal
        assert comparison.left_out is None
    assert compare_with_recorded(late, late, end_ns).left_out is None
    broken = late.windows[3] = dataclasses.replace(late.windows[3], frame_id='elsewhere')
    late.made_at_ns[id(broken)] = end_ns - 10**11
    comparison = compare_with_recorded(without(early, 14), late, end_ns)
    assert not comparison.is_equal


def record_from(source, target, begin_ns):
    """Copy a bag as if its recorder had started later. Earlier events arrive at the start."""
    with TactileBag(source) as bag, BagWriter(target, bag.metadata) as writer:
        for topic in bag.stored_topics:
            writer.add_stored_topic(topic)
        for message in bag.messages():
            if message.type_name == EVENT or message.received_at_ns >= begin_ns:
                at_ns = max(message.received_at_ns, begin_ns)
                writer.write_raw(message.topic, at_ns, message.data)
    return target


@pytest.mark.parametrize(
    ('phase', 'after_ns'),
    # The recording begins after the end of a trial, or in the hold phase of a trial.
    [('done', 2 * 10**8), ('hold', 2 * 10**9)],
)
def test_a_recording_that_begins_after_some_trials_replays_equal(
    stiffness_bag, trained, tmp_path, phase, after_ns
):
    models = ModelSet.load(trained)
    with TactileBag(stiffness_bag) as bag:
        whole = replay_through_core(bag, models, recorded_features(bag))
        events = [e for _, e in read_records(bag.messages(EVENT)) if e.phase == phase]
        assert bag.end_ns == max(message.received_at_ns for message in bag.messages())
    begin_ns = events[3].stamp_ns + after_ns
    bag = record_from(stiffness_bag, tmp_path / 'later', begin_ns)
    live = TactileResults(
        *(
            [r for r in kind if whole.made_at_ns[id(r)] > begin_ns + 5 * 10**8]
            for kind in (whole.windows, whole.classifications)
        ),
        whole.made_at_ns,
    )
    with TactileBag(bag) as later:
        core = replay_through_core(later, models, recorded_features(later))
        found = compare_with_recorded(live, core, later.end_ns, first_sample_ns(later))
    assert found.is_equal, found
    assert 'began before the recording' in found.left_out
    assert found.window_count == found.classification_count == 11
