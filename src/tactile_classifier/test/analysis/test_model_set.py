# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of several models of one finger; each classifies windows of its specification."""

import dataclasses
import shutil

import numpy as np
import pytest

import tactile_classifier
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.model import load_model
from tactile_classifier.model_set import ModelSet
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_classifier.types import PredictionOutcome
from tactile_features.config import FeatureConfig
from tactile_features.model_contract import read_contracts
from tactile_features.spec import spec_for
from tactile_features.types import WindowOutcome

FULL = spec_for('texture', FeatureConfig())
SHORT = spec_for('texture', FeatureConfig(texture_samples=90))
LATER = spec_for('texture', FeatureConfig(texture_crop_start_s=0.9))
EARLY = spec_for('texture', FeatureConfig(texture_samples=60, early_windows=True))
GAPS = spec_for('texture', FeatureConfig(max_gap_samples=3))


def table_of(table, spec, contact='flexion'):
    """Return the table with another specification, and with as many features as it has."""
    columns = {**table.columns, 'contact': np.full(len(table), contact)}
    values = table.values[:, : len(spec.names)]
    return dataclasses.replace(table, values=values, spec=spec, columns=columns)


@pytest.fixture(scope='module')
def folder(small_table, stiffness_table, model_path, early_path, tmp_path_factory):
    """Return a folder of models with different specifications."""
    folder = tmp_path_factory.mktemp('models')
    shutil.copy(model_path, folder / 'a.npz')
    write_model(folder / 'b.npz', train(table_of(small_table, SHORT), 'knn'))
    write_model(folder / 'c.npz', train(stiffness_table, 'tree'))
    shutil.copy(early_path, folder / 'd.npz')
    write_model(folder / 'e.npz', train(table_of(small_table, LATER, 'abduction'), 'tree'))
    (folder / 'x.txt').write_text('no model')
    return folder


@pytest.fixture
def window_of(make_window):
    """Return a function that makes a window of a specification."""

    def make(spec, trial=0, **changes):
        whole = make_window(trial)
        fields = {
            'values': whole.values[: len(spec.names)],
            'sample_count': spec.sample_count,
            'specification_digest': spec.digest,
        }
        return dataclasses.replace(whole, **{**fields, **changes})

    return make


def test_a_folder_is_read_whatever_its_files_are_called(folder):
    models = ModelSet.load(folder)
    alone = [load_model(folder / f'{name}.npz') for name in 'abcde']
    assert [m.model_id for m in models.models] == [model.model_id for model in alone]
    assert models.refused == ()
    assert [info.path for info in models.infos] == [model.path for model in alone]
    first = models.infos[0]
    assert (first.task, first.contact, first.simulated) == ('texture', 'flexion', True)
    assert first.model_id.endswith(first.sha256[:12])
    assert first.labels == alone[0].labels
    assert first.specification_digest == FULL.digest
    contracts, refused = read_contracts(folder, 'flexion')
    assert refused == []
    assert [(c.task, c.contact, c.spec) for c in contracts] == [
        (m.task, m.contact, m.spec) for m in alone[:4]
    ]


def test_each_model_answers_its_windows_as_if_alone(folder, window_of):
    models = ModelSet.load(folder, 'flexion')
    alone = {name: load_model(folder / f'{name}.npz') for name in 'abcd'}
    models.set_specifications([FULL, SHORT, LATER, EARLY])
    for window, names in (
        *((window_of(FULL, trial), 'a') for trial in range(3)),
        *((window_of(SHORT, trial), 'b') for trial in range(3)),
        *((window_of(EARLY, trial), 'd') for trial in range(3)),
        (window_of(LATER), ''),  # its only model is for another contact
    ):
        expected = [alone[name].classify_window(window) for name in names]
        assert models.classify(window) == expected
    lost = window_of(SHORT, outcome=WindowOutcome.GAP, reason='lost', values=np.empty(0))
    (answer,) = models.classify(lost)
    assert (answer.outcome, answer.reason) == (PredictionOutcome.NO_FEATURES, 'lost')


def test_windows_of_another_contact_are_left_out(folder, window_of):
    assert len(ModelSet.load(folder).classify(window_of(FULL, contact='abduction'))) == 1
    models = ModelSet.load(folder, 'flexion')
    assert {info.contact_filter for info in models.infos} == {'flexion'}
    assert [m.contact for m in models.models] == ['flexion', 'flexion', '', 'flexion']
    assert models.classify(window_of(FULL, contact='abduction')) == []
    with pytest.raises(
        ModelFileError, match='are for flexion, but the parameter contact is abduc'
    ):
        ModelSet.load(folder / 'a.npz', 'abduction')


def test_a_window_that_fits_no_model_is_answered_with_the_reason(folder, window_of):
    models = ModelSet.load(folder / 'a.npz')
    (answer,) = models.classify(window_of(GAPS))
    assert (answer.outcome, answer.label) == (PredictionOutcome.NO_FEATURES, '')
    assert 'another specification' in answer.reason
    models.set_specifications([GAPS])
    (answer,) = models.classify(window_of(GAPS))
    assert 'max_gap_samples) differs: required 0.0, found 3' in answer.reason
    (sentence,) = models.unfed
    assert f'set its parameter models to {folder / "a.npz"}' in sentence
    # The specification of the model is announced, so it receives windows that fit it.
    models.set_specifications([GAPS, FULL])
    assert models.classify(window_of(GAPS)) == []
    assert models.unfed == ()


def test_a_file_that_cannot_be_used_is_named_and_the_others_answer(folder, window_of, tmp_path):
    for name, copy in (('a', 'a'), ('b', 'b'), ('a', 'z')):
        shutil.copy(folder / f'{name}.npz', tmp_path / f'{copy}.npz')
    (tmp_path / 'broken.npz').write_bytes(b'hello')
    models = ModelSet.load(tmp_path)
    assert len(models.models) == 2
    broken, same = models.refused
    assert f'{tmp_path / "broken.npz"} is refused: ' in broken
    assert f'{tmp_path / "z.npz"} is the same as' in same
    assert len(models.classify(window_of(SHORT))) == 1


@pytest.mark.parametrize('read', [ModelSet.load, read_contracts])
def test_without_a_usable_model_the_sentence_names_the_folder(tmp_path, read):
    for content, sentence in (
        (None, 'no model files'),
        (b'hello', r'm\.npz is refused: '),
    ):
        if content:
            (tmp_path / 'm.npz').write_bytes(content)
        with pytest.raises(ModelFileError, match=sentence) as caught:
            read(tmp_path)
        assert str(tmp_path) in str(caught.value)
    with pytest.raises(ModelFileError, match='the parameter models is empty'):
        read('')
    with pytest.raises(ModelFileError, match='cannot read model /nowhere/m'):
        read('/nowhere/m')


def test_counts_of_answers(folder, window_of):
    models = ModelSet.load(folder, 'flexion')
    models.set_specifications([FULL, SHORT])
    missing = models.unfed
    assert len(missing) == 2  # the models for holds and for early windows
    assert 'stiffness' in missing[0]
    assert len(models.classify(window_of(FULL))) == 1
    assert models.mismatch is None
    models.classify(window_of(LATER))
    assert 'the window in samples is 180' in models.mismatch
    models.classify(window_of(FULL, feature_set='smell'))
    (early,) = models.classify(window_of(EARLY))
    assert early.model_id == load_model(folder / 'd.npz').model_id
    assert models.counts == {
        'windows': 4,
        'answers': 3,
        'windows for others': 1,
        'windows of another specification': 1,
    }


def test_public_names_exist():
    for name in tactile_classifier.__all__:
        assert getattr(tactile_classifier, name) is not None
    with pytest.raises(AttributeError, match='has no attribute nonsense'):
        tactile_classifier.nonsense  # noqa: B018
