# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Random convolutions against their definition, and against aeon's MiniRocket."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from tactile_classifier.errors import DatasetError
from tactile_classifier.estimators.random_convolutions import RandomConvolutions

REFERENCE = Path(__file__).parents[1] / 'data' / 'minirocket.npz'
"""Signals, biases and features of MiniRocket(random_state=7) of aeon, fitted to five signals."""

CASES = {'offset': 336, 'channels': 336, 'short': 168}


def join(biases):
    return np.concatenate([values.ravel() for values in biases])


def convolve_by_definition(signal, dilation, places):
    """Return one kernel's sum at each sample and the largest magnitude of a term."""
    samples = len(signal)
    sums = np.zeros(samples, dtype=np.longdouble)
    for tap in range(9):
        weight = np.longdouble(2 if tap in places else -1)
        for t in range(samples):
            at = t + (tap - 4) * int(dilation)
            if 0 <= at < samples:
                sums[t] += weight * np.longdouble(signal[at])
    return sums


def check_features(convolutions, signal, largest):
    """Compare features of one channel with the definition; return how many are exact."""
    found = convolutions.transform(signal[None, None])[0]
    # Nine terms, each rounded at sums of no more than twelve magnitudes.
    error = 12 * 12 * np.finfo(np.float32).eps * largest
    at = exact = 0
    for i, (dilation, biases) in enumerate(
        zip(convolutions.dilations, convolutions.biases, strict=True)
    ):
        for k, places in enumerate(combinations(range(9), 3)):
            sums = convolve_by_definition(signal, dilation, places)
            if (i + k) % 2:
                sums = sums[4 * dilation : -4 * dilation]
            for bias in biases[k].astype(np.longdouble):
                low, high = np.mean(sums > bias + error), np.mean(sums > bias - error)
                assert low <= found[at] <= high
                exact += low == high
                at += 1
    assert at == len(found)
    return exact


@pytest.mark.parametrize('samples', [9, 10, 33])
def test_features_of_whole_numbers_are_those_of_the_definition(samples):
    rng = np.random.default_rng(samples)
    x = rng.integers(-9, 10, (6, 1, samples)).astype(np.float32)
    convolutions = RandomConvolutions.fit(x[:5], 336, random_state=1)
    # Sums of whole numbers are exact in any order, so only ties with a bias are open.
    assert check_features(convolutions, x[5, 0], 0.0) == convolutions.feature_count


@pytest.mark.parametrize(
    ('offset', 'change', 'decided'),
    [(0.0, 1.0, 0.99), (1e4, 10.0, 0.9), (1e4, 1e-2, 0.0), (0.0, 1e-40, 0.99)],
)
def test_features_under_an_offset_err_by_the_digits_of_single_precision_only(
    offset, change, decided
):
    rng = np.random.default_rng(3)
    x = (offset + change * rng.normal(size=(6, 1, 40)).cumsum(axis=2)).astype(np.float32)
    convolutions = RandomConvolutions.fit(x[:5], 336, random_state=2)
    exact = check_features(convolutions, x[5, 0], float(np.abs(x).max()))
    assert exact >= decided * convolutions.feature_count


def test_a_constant_signal_has_features_of_its_ends_only():
    x = np.full((4, 1, 50), 3.0) + np.arange(4)[:, None, None]
    convolutions = RandomConvolutions.fit(x, 336)
    values = convolutions.transform(x)
    # The biases inside are 0, which 0 does not exceed: what is left comes from the ends.
    assert len(np.unique(values, axis=0)) == 4
    cropped = np.concatenate(
        [np.repeat((i + np.arange(84)) % 2, b.shape[1]) for i, b in enumerate(convolutions.biases)]
    )
    assert set(np.unique(values[:, cropped == 1])) <= {0.0, 1.0}


def test_a_signal_gives_the_same_bits_alone_and_among_others():
    x = np.random.default_rng(5).normal(size=(40, 3, 100)) * 100
    convolutions = RandomConvolutions.fit(x, 840)
    together = convolutions.transform(x)
    alone = np.concatenate([convolutions.transform(row[None]) for row in x])
    assert together.tobytes() == alone.tobytes()


def test_the_same_seed_gives_the_same_convolutions_and_another_does_not():
    x = np.random.default_rng(6).normal(size=(12, 4, 60))
    first, again, other = (RandomConvolutions.fit(x, 336, random_state=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(join(first.biases), join(again.biases))
    assert not np.array_equal(join(first.biases), join(other.biases))
    assert not np.array_equal(first.sources, other.sources)


@pytest.mark.parametrize(
    ('signals', 'sentence'),
    [
        (np.zeros((3, 1, 8)), 'with 9 samples or more'),
        (np.zeros((0, 1, 20)), 'with 9 samples or more'),
        (np.zeros((3, 20)), 'with 9 samples or more'),
        (np.full((3, 1, 20), np.nan), 'not finite in single precision'),
        (np.full((3, 1, 20), 1e40), 'not finite in single precision'),
    ],
)
def test_signals_that_cannot_be_convolved_are_refused(signals, sentence):
    with pytest.raises(DatasetError, match=sentence):
        RandomConvolutions.fit(signals)


def test_signals_of_another_shape_than_the_fit_are_refused():
    convolutions = RandomConvolutions.fit(np.zeros((3, 2, 20)), 84)
    with pytest.raises(DatasetError, match='1 channels of 20 samples'):
        convolutions.transform(np.zeros((3, 1, 20)))


@pytest.mark.parametrize('case', CASES)
def test_biases_and_features_are_those_that_aeon_gave(case):
    with np.load(REFERENCE, allow_pickle=False) as stored:
        x, biases, values = (
            stored[f'{case}_{name}'] for name in ('signals', 'biases', 'features')
        )
    convolutions = RandomConvolutions.fit(x[:5], CASES[case], random_state=7)
    np.testing.assert_array_equal(join(convolutions.biases), biases)
    np.testing.assert_allclose(convolutions.transform(x[5:]), values, rtol=0, atol=1e-6)
