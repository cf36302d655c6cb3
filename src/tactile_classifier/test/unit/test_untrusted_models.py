# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Predictions from the arrays of a model file; damaged and malicious files are refused."""

import dataclasses

from model_checks import change_file
import numpy as np
import pytest

from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file import prediction
from tactile_classifier.model_file.manifest import Confidence
from tactile_classifier.model_file.model import load_model, TactileModel
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.model_container import MAX_MODEL_BYTES, open_container
from tactile_features.spec import spec_for


def test_equal_distances_go_to_the_earlier_trial_and_equal_votes_to_the_first_label():
    def answer(trials, labels, row=(0.0,)):
        names, codes = np.unique(list(labels), return_inverse=True)
        knn = prediction.Neighbours(np.array(trials)[:, None], np.eye(len(names))[codes])
        return names[knn.compute(np.array(row)).argmax()]

    assert answer([1.0, -2.0, 3.0], 'cba') == 'a'  # if votes are equal, the first label
    assert answer([0.1, 1.0, 1.1, 9.0], 'abba') == 'b'
    assert answer([1.0] * 5, 'babaa') == 'b'  # the three earliest of equal trials
    assert answer([1.0, -1.0, 1.0, -1.0], 'bbaa') == 'b'


def test_a_pair_of_labels_with_a_value_of_zero_votes_for_the_first():
    np.testing.assert_array_equal(prediction.count_votes(np.array([0.5])), [-0.5, 0.5])
    votes = prediction.count_votes(np.zeros(3))
    np.testing.assert_array_equal(votes, [2.0, 1.0, 0.0])
    # Label 0 loses both of its pairs. Label 1 wins both of its pairs, (0, 1) and (1, 2).
    one_sided = prediction.count_votes(np.array([-1.0, -1.0, 1e-300]))
    assert one_sided.argmax() == 1
    np.testing.assert_allclose(one_sided, [-2 / 9, 2 + 1 / 6, 1 + 1 / 6])


# -- damaged files ------------------------------------------------------------------


def test_damaged_bytes_are_refused(model_path):
    data = model_path.read_bytes()
    rng = np.random.default_rng(0)
    damaged = [data[:size] for size in (*range(40), *range(40, len(data), 9_973), len(data) - 1)]
    for at in rng.integers(0, len(data), 100):
        damaged.append(bytearray(data))
        damaged[-1][at] ^= 1 << rng.integers(8)
    whole = TactileModel(data)
    for each in damaged:
        try:
            found = TactileModel(bytes(each))
        except ModelFileError:
            continue
        # The damaged bit does not belong to the contents; it may be in a date, for example.
        assert len(each) == len(data)
        assert found.manifest == whole.manifest


@pytest.mark.parametrize('content', [b'', b'hello, world', b'\x80\x04\x95'])
def test_what_is_no_model_is_refused_with_its_path(tmp_path, content):
    path = tmp_path / 'm.npz'
    with pytest.raises(ModelFileError, match=r'cannot read model .*: No such file'):
        load_model(path)
    path.write_bytes(content)
    with pytest.raises(ModelFileError, match=r'm\.npz is refused: it is not an \.npz file'):
        load_model(path)
    with path.open('wb') as file:
        file.truncate(MAX_MODEL_BYTES + 1)
    with pytest.raises(ModelFileError, match='the limit is 64 MiB'):
        load_model(path)


# -- untrusted models with a valid digest -------------------------------------------


@pytest.mark.parametrize(
    ('name', 'edit', 'message'),
    [
        ('classifier.coefficients', lambda a: None, 'has no array "classifier.coefficients"'),
        ('novelty.within', lambda a: None, 'it has no array "novelty.within"'),
        ('classifier.trials', lambda a: np.zeros(3), 'unexpected array "classifier.trials"'),
        (
            '60.classifier.intercept',
            lambda a: np.zeros(3),
            'unexpected array "60.classifier.intercept"',
        ),
        ('classifier.intercept', lambda a: a.astype(np.float32), 'has type float32, not float64'),
        ('classifier.intercept', lambda a: np.arange(3), 'has type int64, not float64'),
        ('classifier.coefficients', lambda a: a[:, 1:], r'shape \(3, 90\); it must be \(3, 91\)'),
        ('classifier.coefficients', lambda a: a[0], r'has shape \(91,\); it must be'),
        ('classifier.intercept', lambda a: a[:2], r'shape \(2,\); it must be \(3,\), that is'),
        ('novelty.means', lambda a: a[:2], r'shape \(2, 91\); it must be \(3, 91\)'),
        ('novelty.references', lambda a: a * np.nan, 'has values that are not finite'),
        ('classifier.intercept', lambda a: a + np.inf, 'has values that are not finite'),
        ('novelty.scales', lambda a: a * 0.0, r'"scales" are not positive \(novelty\)'),
    ],
)
def test_an_array_that_does_not_fit_is_named(model_path, name, edit, message):
    old = open_container(model_path.read_bytes()).arrays.get(name)
    with pytest.raises(ModelFileError, match=message):
        TactileModel(change_file(model_path, {name: edit(old)}))


def test_arrays_under_the_manifest_of_another_model_are_refused(model_path):
    manifest = load_model(model_path).manifest
    half = spec_for('texture', FeatureConfig(texture_samples=90))

    def load(**changes):
        entries = dataclasses.replace(manifest, **changes).to_dict()
        TactileModel(change_file(model_path, **entries))

    load()
    for changes, message in (
        ({'labels': ('a', 'b', 'c', 'd')}, 'values of its array "intercept" are inconsistent'),
        ({'spec': half}, r'it must be \(3, 46\)'),
        ({'confidence': Confidence()}, 'its calibration and its kind of scores are inconsistent'),
        ({'scaling': 'standard'}, 'has no array "scaling.mean"'),
        ({'classifier': 'tree'}, 'has no array "classifier.feature"'),
        (
            {'confidence': dataclasses.replace(manifest.confidence, novelty_threshold=-1.0)},
            'unexpected array "novelty.centre"',
        ),
    ):
        with pytest.raises(ModelFileError, match=message):
            load(**changes)


def test_a_card_that_a_terminal_would_obey_is_refused(model_path):
    for card, message in (
        ('\x1b[2J', 'not plain text'),
        (3, 'not plain text'),
        ('a' * 70_000, 'KiB'),
    ):
        with pytest.raises(ModelFileError, match=message):
            TactileModel(change_file(model_path, card=card))


@pytest.fixture(scope='module')
def tree_path(small_table, tmp_path_factory):
    path = tmp_path_factory.mktemp('tree') / 'tree.npz'
    write_model(path, train(small_table, 'tree'))
    return path


@pytest.mark.parametrize(
    ('name', 'edit'),
    [
        ('feature', lambda a: np.where(a >= 0, 91, a)),
        ('feature', lambda a: np.where(a >= 0, -1, a)),
        ('below', lambda a: np.where(a >= 0, 0, a)),  # the path returns to the root
        ('above', lambda a: np.where(a >= 0, len(a), a)),
    ],
)
def test_a_tree_without_an_end_is_refused(tree_path, name, edit):
    old = open_container(tree_path.read_bytes()).arrays[f'classifier.{name}']
    with pytest.raises(ModelFileError, match=f'"{name}" are inconsistent with other arrays'):
        TactileModel(change_file(tree_path, {f'classifier.{name}': edit(old)}))
