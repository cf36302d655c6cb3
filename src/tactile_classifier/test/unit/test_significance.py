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

import itertools

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
import numpy as np
import pytest
from scipy.stats import mannwhitneyu

from tactile_classifier.errors import DatasetError
from tactile_classifier.significance import rank_features, rank_sum_p_values


def peer_p_values(values, labels):
    """One test by SciPy for each pair and feature; 1 where all values of both are equal."""
    labels = np.asarray(labels)
    names = sorted(set(labels.tolist()))
    p = np.ones((values.shape[1], len(names), len(names)))
    for (i, a), (j, b) in itertools.combinations(enumerate(names), 2):
        for k in range(values.shape[1]):
            pair = values[labels == a, k], values[labels == b, k]
            if len(set(np.concatenate(pair).tolist())) > 1:
                p[k, i, j] = p[k, j, i] = mannwhitneyu(*pair, method='asymptotic').pvalue
    return p


@pytest.mark.parametrize('step', [0.0, 0.25, 1.0])
def test_p_is_that_of_scipy_with_and_without_ties(step):
    rng = np.random.default_rng(1)
    labels = np.repeat(['rubber', 'PLA', 'steel', 'foam'], [3, 40, 17, 60])
    values = rng.normal(size=(120, 6)) + 0.6 * np.arange(6) * (labels == 'PLA')[:, None]
    if step:
        values = np.round(values / step) * step
    order = rng.permutation(120)
    found = rank_sum_p_values(values[order], labels[order])
    expected = peer_p_values(values, labels)
    assert found.labels == ('PLA', 'foam', 'rubber', 'steel')
    np.testing.assert_allclose(found.p, expected, rtol=1e-15, atol=0)
    assert expected.min() < 1e-6  # else tiny p-values were not looked at


@given(
    arrays(
        np.float64,
        st.tuples(st.integers(2, 25), st.integers(1, 4)),
        elements=st.integers(-3, 3).map(float),
    ),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=40, deadline=None)
def test_p_is_that_of_scipy_on_any_table(values, seed):
    labels = np.random.default_rng(seed).choice(['a', 'b', 'c'], len(values))
    labels[:2] = 'a', 'b'
    found = rank_sum_p_values(values, labels)
    np.testing.assert_allclose(found.p, peer_p_values(values, labels), rtol=1e-15, atol=0)


def test_many_features_go_in_blocks_with_the_same_result():
    rng = np.random.default_rng(2)
    labels = np.repeat([f'T{i}' for i in range(12)], 10)
    values = np.round(rng.normal(size=(120, 400)), 1)
    whole = rank_sum_p_values(values, labels)
    for k in (0, 138, 139, 399):
        assert np.array_equal(rank_sum_p_values(values[:, [k]], labels).p[0], whole.p[k])


def test_the_measure_is_the_mean_over_pairs_and_the_diagonal_no_test():
    labels = ['a'] * 30 + ['b'] * 30 + ['c'] * 30
    values = np.random.default_rng(3).normal(size=(90, 2))
    values[:30, 0] += 2.0
    found = rank_sum_p_values(values, labels)
    assert np.array_equal(found.p, found.p.transpose(0, 2, 1))
    assert (found.p[:, [0, 1, 2], [0, 1, 2]] == 1.0).all()
    expected = (found.p[:, 0, 1] + found.p[:, 0, 2] + found.p[:, 1, 2]) / 3
    np.testing.assert_allclose(found.mean_p, expected, rtol=1e-15)


def test_features_are_ranked_from_the_most_telling():
    labels = np.repeat(['a', 'b'], 40)
    values = np.random.default_rng(4).normal(size=(80, 4))
    values[:, 0] = 0.0  # the component at 0 Hz tells nothing
    values[40:, 2] += 3.0
    values[40:, 3] += 1.0
    order = rank_features(values, labels).tolist()
    assert order[:2] == [2, 3]
    assert order[-1] == 0
    assert rank_sum_p_values(values, labels).mean_p[0] == 1.0


@pytest.mark.parametrize(
    ('values', 'labels', 'message'),
    [
        (np.ones(4), ['a'] * 4, 'shapes'),
        (np.ones((4, 2)), ['a'] * 3, 'shapes'),
        (np.ones((4, 2)), ['a'] * 4, 'there are 1'),
        (np.full((2, 1), np.nan), ['a', 'b'], 'not finite'),
    ],
)
def test_refuses_what_cannot_be_tested(values, labels, message):
    with pytest.raises(DatasetError, match=message):
        rank_sum_p_values(values, labels)
