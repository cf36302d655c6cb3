# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of `TactileClassifier`, which writes pipelines to model files."""

from pathlib import Path
import pickle
import re

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import cross_val_score, GridSearchCV, LeaveOneGroupOut
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import MinMaxScaler, StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier

import tactile_classifier
from tactile_classifier import load_model, TactileClassifier
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.storage import open_model
from tactile_classifier.training.model_writer import pack_trained
from tactile_classifier.training.trainer import train
from tactile_classifier.types import NO_ANSWER, UNKNOWN
from tactile_features.estimators import (
    StiffnessRegression,
    StiffnessRelaxation,
    TextureSpatial,
    TextureSpectrum,
)


def make_windows(each=24, samples=180, noise_n=0.02):
    """Return windows of three plates in four sessions."""
    rng = np.random.default_rng(5)
    labels = np.repeat(['coarse', 'fine', 'smooth'], each)
    pitch_hz = np.repeat([4.0, 9.0, 17.0], each)[:, np.newaxis]
    phase = 2 * np.pi * (pitch_hz * np.arange(samples) / 60 + rng.random((3 * each, 1)))
    windows = 3.0 + 0.05 * np.sin(phase) + rng.normal(0.0, noise_n, (3 * each, samples))
    return windows, labels, np.arange(3 * each) % 4


def linear(**options):
    return make_pipeline(TextureSpectrum(), StandardScaler(), SVC(kernel='linear', **options))


@pytest.fixture(scope='module')
def fitted():
    windows, labels, sessions = make_windows()
    return TactileClassifier(linear(), contact='flexion').fit(windows, labels, groups=sessions)


def contents(data):
    opened = open_model(data)
    facts = {**opened.manifest.to_dict(), 'created': ''}
    parts = opened.predictor.classifier, opened.predictor.scaling, opened.predictor.novelty
    arrays = {
        (type(part).__name__, name): getattr(part, name)
        for part in parts
        if part is not None
        for name in part.SHAPES
    }
    return facts, arrays, opened.predictor.calibration


def assert_same(first, second):
    (facts, arrays, calibration), (other_facts, others, other_calibration) = first, second
    assert facts == other_facts
    assert calibration == other_calibration
    assert arrays.keys() == others.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, others[name], err_msg=str(name))


@pytest.mark.parametrize(
    ('features', 'classifier', 'names'),
    [
        (TextureSpectrum(), SVC(kernel='linear'), ('svm_linear', 'standard')),
        (TextureSpectrum(detrend='mean'), SVC(), ('svm_rbf', 'none')),
        (TextureSpectrum(), KNeighborsClassifier(3), ('knn', 'none')),
        (StiffnessRegression(), DecisionTreeClassifier(), ('tree', 'none')),
    ],
    ids=lambda value: value if isinstance(value, tuple) else type(value).__name__,
)
def test_model_is_the_one_of_the_trainer(features, classifier, names, tmp_path):
    windows, labels, sessions = make_windows(each=12)
    scaling = [StandardScaler()] if names[1] == 'standard' else ['passthrough']
    pipeline = make_pipeline(features, *scaling, classifier)
    model = TactileClassifier(pipeline).fit(windows, labels, groups=sessions)
    model.save(tmp_path / 'm.npz')
    spectrum = features.fit(windows)
    columns = {'session_id': sessions}
    table = FeatureTable(spectrum.transform(windows), labels, spectrum.specification_, columns)
    expected = contents(pack_trained(train(table, *names)))
    assert_same(contents((tmp_path / 'm.npz').read_bytes()), expected)
    again = load_model(tmp_path / 'm.npz')
    assert again.predict(windows).tolist() == model.predict(windows).tolist()
    assert (
        model.predict(windows).tolist() == model.trained_.estimator.predict(table.values).tolist()
    )


def test_loaded_model_takes_windows_or_rows_of_features(fitted, tmp_path):
    windows, labels, _ = make_windows()
    new = np.concatenate([windows[::7], 3.0 + 0.5 * np.cos(np.arange(180))[np.newaxis]])
    rows = TextureSpectrum().fit(new).transform(new)
    fitted.save(tmp_path / 'm.npz')
    model = load_model(tmp_path / 'm.npz')
    for given in (new, rows):
        assert model.predict(given).tolist() == fitted.predict(new).tolist()
        assert model.predict_or_unknown(given).tolist() == fitted.predict_or_unknown(new).tolist()
        for name in ('predict_proba', 'novelty', 'p_value'):
            np.testing.assert_array_equal(getattr(model, name)(given), getattr(fitted, name)(new))
    assert fitted.predict(new)[:-1].tolist() == labels[::7].tolist()
    assert fitted.predict_or_unknown(new)[-1] == UNKNOWN
    assert fitted.predict(new)[-1] in fitted.classes_
    np.testing.assert_allclose(fitted.predict_proba(new).sum(axis=1), 1.0)
    assert fitted.p_value(new)[-1] < 0.05 < fitted.p_value(new)[:-1].mean()
    answers = [model.classify(window, 60.0) for window in new]
    assert [answer.label for answer in answers] == model.predict_or_unknown(new).tolist()
    assert [answer.p_value for answer in answers] == model.p_value(new).tolist()
    assert (model.contact, model.manifest.calibration['groups']) == ('flexion', 4)
    assert pickle.loads(pickle.dumps(fitted)).predict(new).tolist() == fitted.predict(new).tolist()


def test_windows_without_features_have_no_answer(tmp_path):
    windows, labels, _ = make_windows(each=12)
    model = TactileClassifier(
        make_pipeline(StiffnessRelaxation(1000.0), DecisionTreeClassifier())
    ).fit(windows, labels)
    new = np.stack([windows[0], np.arange(180.0)])  # the second one's intercept is 0 N
    assert model.predict_or_unknown(new)[1] == NO_ANSWER
    with pytest.raises(ValueError, match='window 1'):
        model.predict(new)


def test_features_over_distance_take_their_speeds(tmp_path):
    windows, labels, sessions = make_windows(each=12, samples=200)
    speeds_m_s = np.tile([0.015, 0.0145], 18)
    x = np.column_stack([windows, speeds_m_s])
    model = TactileClassifier(make_pipeline(TextureSpatial(), KNeighborsClassifier(3)))
    model.fit(x, labels, groups=sessions).save(tmp_path / 'm.npz')
    loaded = load_model(tmp_path / 'm.npz')
    assert loaded.predict(windows, speed_m_s=speeds_m_s).tolist() == model.predict(x).tolist()
    rows = TextureSpatial().fit(x).transform(x)
    assert loaded.predict(rows).tolist() == model.predict(x).tolist()
    assert loaded.manifest.training.speeds == 2


@pytest.mark.parametrize('labels', [[10, 9, -1], [2.0, 0.0, 10.0], [True, False, True]])
def test_labels_keep_their_type_and_order(labels):
    windows, _, sessions = make_windows(each=12)
    y = np.repeat(labels, 12)
    model = TactileClassifier(linear()).fit(windows, y, groups=sessions)
    assert model.classes_.tolist() == np.unique(labels).tolist()
    assert np.mean(model.predict(windows) == y) > 0.6
    best = model.predict_proba(windows).argmax(axis=1)
    np.testing.assert_array_equal(model.classes_[best], model.predict(windows))
    assert set(model.predict_or_unknown(windows)) <= {*labels, UNKNOWN}


def test_parameters_of_the_classifier_count_and_are_stated(tmp_path):
    windows, labels, sessions = make_windows(each=12, noise_n=0.1)
    weights = {'coarse': 1.0, 'fine': 2.0, 'smooth': 1.0}
    strong = TactileClassifier(linear(C=0.003, class_weight=weights))
    strong.fit(windows, labels, groups=sessions)
    model = strong.save(tmp_path / 'm.npz')
    assert model.manifest.parameters == {'C': 0.003, 'class_weight': weights}
    assert 'C 0.003' in load_model(tmp_path / 'm.npz').card
    usual = TactileClassifier(linear()).fit(windows, labels, groups=sessions)
    assert usual.model_.manifest.parameters == {}
    assert not np.array_equal(usual.predict_proba(windows), strong.predict_proba(windows))
    numbers = np.unique(labels, return_inverse=True)[1]
    by_number = TactileClassifier(linear(C=0.003, class_weight={0: 1.0, 1: 2.0, 2: 1.0}))
    by_number.fit(windows, numbers, groups=sessions)
    np.testing.assert_array_equal(by_number.predict_proba(windows), strong.predict_proba(windows))


@pytest.mark.parametrize(
    ('pipeline', 'named'),
    [
        (make_pipeline(TextureSpectrum(), LogisticRegression()), 'LogisticRegression'),
        (make_pipeline(TextureSpectrum(), KNeighborsClassifier(5)), 'KNeighborsClassifier'),
        (make_pipeline(TextureSpectrum(), SVC(kernel='poly')), 'poly'),
        (make_pipeline(TextureSpectrum(), MinMaxScaler(), SVC()), 'MinMaxScaler'),
        (make_pipeline(StandardScaler(), SVC()), 'StandardScaler'),
        (make_pipeline(TextureSpectrum()), 'None'),
        (SVC(), 'SVC'),
    ],
)
def test_pipelines_that_no_file_can_hold_are_refused(pipeline, named):
    windows, labels, _ = make_windows(each=6)
    with pytest.raises(ValueError, match=named) as caught:
        TactileClassifier(pipeline).fit(windows, labels)
    if named not in ('StandardScaler', 'SVC'):
        assert 'joblib' in str(caught.value)


def test_label_that_means_no_label_is_refused():
    windows, labels, _ = make_windows(each=6)
    labels = np.where(labels == 'fine', UNKNOWN, labels)
    with pytest.raises(ModelFileError, match=UNKNOWN):
        TactileClassifier(linear()).fit(windows, labels)


def test_too_few_windows_are_a_warning_and_have_no_probabilities():
    windows, labels, _ = make_windows(each=5)
    with pytest.warns(UserWarning, match='needs 19 trials'):
        model = TactileClassifier(linear()).fit(windows, labels)
    assert np.mean(model.predict(windows) == labels) > 0.8
    for method in (model.predict_proba, model.novelty, model.p_value):
        with pytest.raises(ValueError, match='needs 19 trials'):
            method(windows)


def test_groups_that_cannot_be_held_out_are_a_warning():
    windows, labels, _ = make_windows(each=12)
    with pytest.warns(UserWarning, match='only one group'):
        TactileClassifier(linear()).fit(windows, labels, groups=labels)


def test_pipeline_can_be_searched_and_cross_validated():
    windows, labels, sessions = make_windows(each=12, noise_n=0.005)
    options = {'groups': sessions, 'cv': LeaveOneGroupOut()}
    scores = cross_val_score(TactileClassifier(linear()), windows, labels, **options)
    assert scores.tolist() == cross_val_score(linear(), windows, labels, **options).tolist()
    assert scores.mean() > 0.5
    grid = {'pipeline__svc__C': [1e-6, 1.0]}
    search = GridSearchCV(TactileClassifier(linear()), grid, cv=LeaveOneGroupOut())
    search.fit(windows, labels, groups=sessions)
    assert search.best_score_ >= scores.mean()


def test_names_of_the_package_are_listed():
    assert {'TactileClassifier', 'RandomConvolutionClassifier'} <= set(dir(tactile_classifier))
    assert set(tactile_classifier.__all__) <= set(dir(tactile_classifier))


def test_example_of_the_page_runs(tmp_path, monkeypatch, capsys):
    page = (Path(__file__).resolve().parents[4] / 'docs' / 'your_data.md').read_text('utf-8')
    section = page.partition('## Your own pipeline\n')[2].partition('\n## ')[0]
    (code,) = re.findall(r'```python\n(.*?)```', section, flags=re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, 'your_data.md', 'exec'), {'__name__': 'example'})
    assert (tmp_path / 'texture.npz').exists()
    assert capsys.readouterr().out.splitlines()[-1] == "['rough' 'rough']"
