# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Several models of one finger: each answers the windows of its specification."""

import dataclasses
import shutil

import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from tactile_classifier.answering import Answering, LiveRecalibration, ModelSet
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.model import load_model
from tactile_classifier.records import Outcome
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.model_contract import read_contracts
from tactile_features.records import Outcome as FeatureOutcome
from tactile_features.spec import FeatureSpecifications, spec_for, WantedFeatures

SHORT = spec_for('texture', FeatureConfig(texture_samples=90))
LATER = spec_for('texture', FeatureConfig(texture_crop_start_s=0.9))


def table_of(table, spec, contact='flexion'):
    """The table as if of another specification, with so many columns."""
    columns = {**table.columns, 'contact': np.full(len(table), contact)}
    return dataclasses.replace(
        table, values=table.values[:, : len(spec.names)], spec=spec, columns=columns
    )


@pytest.fixture(scope='module')
def folder(small_table, stiffness_table, partial_tables, tmp_path_factory):
    """Return a folder of models; the names of the files say nothing."""
    folder = tmp_path_factory.mktemp('models')
    whole, partial = partial_tables
    write_model(folder / 'a.onnx', train(small_table, 'svm_linear'))
    write_model(folder / 'b.onnx', train(table_of(small_table, SHORT), 'knn'))
    write_model(folder / 'c.onnx', train(stiffness_table, 'tree'))
    write_model(folder / 'd.onnx', train(whole, 'knn', partial=partial))
    write_model(folder / 'e.onnx', train(table_of(small_table, LATER, 'abduction'), 'tree'))
    return folder


@pytest.fixture
def window_of(make_window):
    """Return a maker of windows of a specification."""

    def make(spec, trial=0, **changes):
        whole = make_window(trial)
        fields = {
            'values': whole.values[: len(spec.names)],
            'sample_count': spec.sample_count,
            'specification_digest': spec.digest,
        }
        return dataclasses.replace(whole, **{**fields, **changes})

    return make


@pytest.fixture
def full(small_table):
    return small_table.spec


def test_a_folder_is_read_whatever_its_files_are_called(folder):
    models = ModelSet.load(folder)
    alone = {name: load_model(folder / f'{name}.onnx') for name in 'abcde'}
    assert [m.model_id for m in models.models] == [alone[name].model_id for name in 'abcde']
    assert models.refused == ()
    assert models.partial_samples == (60, 120)
    assert [info.path for info in models.infos] == [
        str(folder / f'{name}.onnx') for name in 'abcde'
    ]
    first = models.infos[0]
    assert (first.task, first.contact) == ('texture', 'flexion')
    assert first.model_id.endswith(first.sha256[:12])
    assert first.labels == alone['a'].labels
    assert first.specification_digest == alone['a'].spec.digest
    assert first.simulated
    assert first.recalibration_trials == 0


def test_each_model_answers_its_windows_as_if_alone(folder, window_of, full):
    models = ModelSet.load(folder, 'flexion')
    alone = {name: load_model(folder / f'{name}.onnx') for name in 'abcd'}
    models.set_specifications([full, SHORT, LATER])
    for trial in range(3):
        whole, short = window_of(full, trial), window_of(SHORT, trial)
        assert models.classify(whole) == [
            alone['a'].classify_window(whole),
            alone['d'].classify_window(whole),
        ]
        assert models.classify(short) == [alone['b'].classify_window(short)]
        part = window_of(full, trial, partial=True, sample_count=60)
        assert models.classify(part) == [alone['d'].classify_window(part)]
    assert models.classify(window_of(full, partial=True, sample_count=90)) == []
    assert models.classify(window_of(LATER)) == []  # of a model for another contact
    lost = window_of(SHORT, outcome=FeatureOutcome.GAP, reason='lost', values=np.empty(0))
    (answer,) = models.classify(lost)
    assert (answer.outcome, answer.reason) == (Outcome.NO_FEATURES, 'lost')


def test_windows_of_another_contact_are_left_out(folder, window_of, full):
    assert len(ModelSet.load(folder).classify(window_of(full, contact='abduction'))) == 1
    models = ModelSet.load(folder, 'flexion')
    assert {info.contact_filter for info in models.infos} == {'flexion'}
    assert [m.contact for m in models.models] == ['flexion', 'flexion', '', 'flexion']
    assert models.classify(window_of(full, contact='abduction')) == []
    with pytest.raises(ModelFileError, match='are for flexion, the parameter contact is abduc'):
        ModelSet.load(folder / 'a.onnx', 'abduction')


def test_a_window_that_fits_no_model_is_answered_with_the_reason(folder, window_of, full):
    other = spec_for('texture', FeatureConfig(max_gap_samples=3))
    models = ModelSet.load(folder / 'a.onnx')
    (answer,) = models.classify(window_of(other))
    assert (answer.outcome, answer.label) == (Outcome.NO_FEATURES, '')
    assert 'another specification' in answer.reason
    models.set_specifications([other])
    (answer,) = models.classify(window_of(other))
    assert 'max_gap_samples) differs: 0.0 here, 3 there' in answer.reason
    (sentence,) = models.unfed
    assert 'give its parameter models' in sentence
    assert str(folder / 'a.onnx') in sentence
    # The windows of its own are announced: those of another specification are for others.
    models.set_specifications([other, full])
    assert models.classify(window_of(other)) == []
    assert models.unfed == ()


def test_a_file_that_cannot_be_used_is_named_and_the_others_answer(folder, window_of, tmp_path):
    for name in 'abd':
        shutil.copy(folder / f'{name}.onnx', tmp_path / f'{name}.onnx')
    (tmp_path / 'broken.onnx').write_bytes(b'hello')
    shutil.copy(folder / 'a.onnx', tmp_path / 'z.onnx')
    models = ModelSet.load(tmp_path)
    assert len(models.models) == 3
    assert [sentence.split()[1] for sentence in models.refused] == [
        str(tmp_path / 'broken.onnx'),
        str(tmp_path / 'z.onnx'),
    ]
    assert 'it is not an ONNX file' in models.refused[0]
    assert 'is the same as' in models.refused[1]
    assert len(models.classify(window_of(SHORT))) == 1


@pytest.mark.parametrize(
    ('content', 'sentence'),
    [(None, 'no model files'), (b'hello', 'is refused: it is not an ONNX file')],
)
def test_without_a_usable_model_the_sentence_names_the_folder(tmp_path, content, sentence):
    if content:
        (tmp_path / 'm.onnx').write_bytes(content)
    for read in (ModelSet.load, read_contracts):
        with pytest.raises(ModelFileError, match=sentence) as caught:
            read(tmp_path)
        assert str(tmp_path) in str(caught.value)
        with pytest.raises(ModelFileError, match='the parameter models is empty'):
            read('')
        with pytest.raises(ModelFileError, match='cannot read model /nowhere/m'):
            read('/nowhere/m')


def test_each_model_is_recalibrated_by_itself(folder, window_of, full, small_table):
    (folder / 'x.txt').write_text('no model')
    models = ModelSet.load(folder, 'flexion', 5)
    # The models of the folder that state nothing of sessions are refused.
    assert [i.recalibration_trials for i in models.infos] == [5] * len(models.models)
    assert [sentence for sentence in models.refused if 'sessions' in sentence] == [*models.refused]
    assert len(models.refused) == 1
    live = {
        spec.digest: LiveRecalibration(load_model(folder / f'{name}.onnx'), 5)
        for name, spec in (('a', full), ('b', SHORT))
    }
    for trial in (0, 12, 24, 3, 15, 27, 6):
        for spec in (full, SHORT):
            window = window_of(
                spec, trial, session_id='s', object_label=str(small_table.labels[trial])
            )
            assert live[spec.digest].classify(window) in models.classify(window)


def test_contracts_are_those_of_the_models(folder):
    contracts, refused = read_contracts(folder, 'flexion')
    models = ModelSet.load(folder, 'flexion').models
    assert refused == []
    assert [
        (str(c.path), c.task, c.contact, c.wanted.spec, c.wanted.partial_samples)
        for c in contracts
    ] == [(m.path, m.task, m.contact, m.spec, m.partial_samples) for m in models]


def test_counts_and_news_of_answers(folder, window_of, full):
    answering = Answering(ModelSet.load(folder, 'flexion'))
    assert answering.announce(
        FeatureSpecifications((WantedFeatures(full), WantedFeatures(SHORT)))
    ) == (answering.models.unfed[0],)
    assert 'stiffness' in answering.models.unfed[0]
    results = answering.answer(window_of(full))
    assert len(results) == 2
    answering.answer(window_of(LATER))
    answering.answer(window_of(full, feature_set='smell'))
    part = window_of(full, 0, partial=True, sample_count=60)
    (early,) = answering.answer(part)
    answering.answer(part)
    assert answering.values() == {
        'windows': 3,
        'answers': 2,
        'windows for others': 2,
        'windows of another specification': 0,
        'answers on partial windows': 2,
        'recalibrated with trials': 0,
        'models': 4,
        'refused model files': 0,
    }
    news = answering.take_news()
    assert len(news) == early.decided
    assert answering.take_news() == []
