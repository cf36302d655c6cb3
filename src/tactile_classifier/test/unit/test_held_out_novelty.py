# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Thresholds for unknown objects, and p-values, from novelties of held-out trials."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_classifier.confidence.held_out_novelty import (
    HeldOutNovelty,
    rank_of_sessions,
    trials_needed,
)


def by_session(novelty, names='abcdefghijklmnopqrstuvwxyz'):
    """Return `HeldOutNovelty` of an array of shape (sessions, trials)."""
    return HeldOutNovelty(tuple(np.asarray(novelty, dtype=float)), tuple(names[: len(novelty)]))


@pytest.mark.parametrize(('rate', 'needed'), [(0.5, 1), (0.1, 9), (0.01, 99)])
def test_threshold_of_the_fewest_trials_is_their_largest(rate, needed):
    novelty = np.random.default_rng(0).permutation(needed) + 1.0
    assert trials_needed(rate) == needed
    assert HeldOutNovelty((novelty,)).compute_threshold(rate) == needed
    with pytest.raises(ValueError, match=f'needs {needed} trial'):
        HeldOutNovelty((novelty[:-1],)).compute_threshold(rate)


@pytest.mark.parametrize('strict', [False, True])
def test_threshold_holds_its_rate_on_further_trials(strict):
    # If n + 1 trials are exchangeable, the last one exceeds the threshold of the others with a
    # probability of at most the rate, and at least the rate minus 1 / (n + 1).
    novelty = np.random.default_rng(3).exponential(size=(4000, 51))
    above = [
        row[-1] > HeldOutNovelty((row[:-1],)).compute_threshold(0.1, strict=strict)
        for row in novelty
    ]
    assert 0.1 - 1 / 51 - 0.015 < np.mean(above) < 0.1 + 0.015


@pytest.mark.parametrize(
    ('sessions', 'rank'), [(1, 1), (2, 2), (6, 6), (9, 9), (19, 18), (40, 37)]
)
def test_most_sessions_are_bounded_by_one_of_the_largest(sessions, rank):
    assert rank_of_sessions(sessions) == rank


def test_thresholds_of_known_numbers():
    novelty = np.tile(np.arange(40.0), (6, 1))
    novelty[3] += 100.0
    known = by_session(novelty)
    # The strict threshold is the 39th smallest of the 40 novelties of the worst session.
    assert known.compute_threshold(0.05, strict=True) == 138.0
    # At most 12 of 241 trials (5 %) may exceed the threshold: a new trial and 11 of the 240.
    assert known.compute_threshold(0.05) == 128.0
    assert known.reject_sessions(0.05) == (0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    with pytest.raises(ValueError, match='needs 99 trials'):
        by_session(novelty[:2]).compute_threshold(0.01)


def test_each_session_has_the_same_weight():
    few, many = np.arange(100.0) + 100.0, np.arange(900.0) / 10
    threshold = HeldOutNovelty((few, many), ('few', 'many')).compute_threshold(0.1)
    # If a fifth of ``few`` and nothing of ``many`` is rejected, the mean is a tenth.
    assert np.mean(few > threshold) == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize('sessions', [6, 19])
def test_the_default_holds_in_the_mean_and_the_strict_threshold_in_most_sessions(sessions):
    rng = np.random.default_rng(12)

    def draw(count):
        return np.exp(0.3 * rng.normal(size=(count, 1)) + 0.5 * rng.normal(size=(count, 60)))

    names = list(map(str, range(sessions)))
    means, held, held_by_default = [], [], []
    for _ in range(300):
        known, new = by_session(draw(sessions), names), draw(20)
        rejected = (new > known.compute_threshold(0.1)).mean(axis=1)
        means.append(rejected.mean())
        held_by_default.append(np.mean(rejected <= 0.1))
        strict = known.compute_threshold(0.1, strict=True)
        held.append(np.mean((new > strict).mean(axis=1) <= 0.1))
    assert np.mean(means) == pytest.approx(0.1, abs=0.02)
    stated = rank_of_sessions(sessions) / (sessions + 1)
    assert np.mean(held) == pytest.approx(stated, abs=0.04)
    assert np.mean(held_by_default) < stated - 0.1


# Novelties are whole numbers from 0 to 9, so that many of them are equal. They are drawn as bytes,
# because this takes a tenth of the time of a list of numbers.
SESSIONS = st.lists(
    st.binary(min_size=1, max_size=30).map(lambda data: np.frombuffer(data, np.uint8) % 10.0),
    min_size=1,
    max_size=4,
).filter(lambda sessions: sum(map(len, sessions)) >= 19)


@settings(max_examples=200, deadline=None)
@given(SESSIONS, st.sampled_from([0.05, 0.1, 0.3]), st.integers(0, 10).map(float))
def test_the_p_value_is_at_most_the_rate_exactly_above_the_threshold(sessions, rate, novelty):
    known = HeldOutNovelty(tuple(sessions), tuple('abcd'[: len(sessions)]))
    is_above = novelty > known.compute_threshold(rate)
    assert (known.compute_p_value(novelty) <= rate) == is_above


def test_false_rejection_of_a_session_is_by_the_threshold_of_the_others():
    rng = np.random.default_rng(1)
    novelty = rng.exponential(size=(4, 50))
    novelty[2] += 2.0
    known = by_session(novelty)
    for strict in (False, True):
        found = known.reject_sessions(0.1, strict=strict)
        for i in range(4):
            others = by_session(np.delete(novelty, i, axis=0))
            threshold = others.compute_threshold(0.1, strict=strict)
            assert found[i] == np.mean(novelty[i] > threshold)
        assert max(found) == found[2]
    assert HeldOutNovelty((novelty[0],)).reject_sessions(0.1) == ()


def test_what_is_written_is_read():
    known = by_session([[3.0, 1.0, 2.0], [5.0, 4.0, 6.0]])
    read = HeldOutNovelty.read(known.to_dict())
    assert read.names == ('a', 'b')
    assert [each.tolist() for each in read.sessions] == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
