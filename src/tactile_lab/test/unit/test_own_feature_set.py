# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A feature set that another package provides, as in the example of docs/feature_sets.md."""

import dataclasses
import importlib
from pathlib import Path
import re
import sys

import numpy as np
import pytest

from tactile_classifier.datasets.dataset import table_from_trials
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features import (
    check_feature_set,
    FeatureConfig,
    FeatureError,
    features_from_trials,
    spec_for,
    TrialEvent,
    TrialFeatureExtractor,
    WindowOutcome,
)
from tactile_features.feature_sets.registry import find_feature_set, GROUP, list_feature_sets
from tactile_ros.strain import StrainBlock

PAGE = Path(__file__).resolve().parents[4] / 'docs' / 'feature_sets.md'
RATE_HZ = 62.5
PERIOD_NS = 16_000_000


def install(monkeypatch, folder, value='roughness:Roughness', name='roughness'):
    """Write the files that pip would install for the package of the example."""
    if not PAGE.is_file():
        pytest.skip('the packages are not in their own repository: no docs beside them')
    metadata = folder / f'{name}-1.0.dist-info'
    metadata.mkdir(parents=True)
    (metadata / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n')
    (metadata / 'entry_points.txt').write_text(f'[{GROUP}]\n{name} = {value}\n')
    examples = re.findall(r'```python\n(.*?)```', PAGE.read_text(), re.S)
    (example,) = (each for each in examples if 'class Roughness' in each)
    (folder / 'roughness.py').write_text(example)
    monkeypatch.syspath_prepend(str(folder))
    importlib.invalidate_caches()
    find_feature_set.cache_clear()


@pytest.fixture(autouse=True)
def forget():
    yield
    find_feature_set.cache_clear()


@pytest.fixture
def roughness(monkeypatch, tmp_path):
    install(monkeypatch, tmp_path / 'site')
    return FeatureConfig(rate_hz=RATE_HZ, texture_samples=120, texture_features='roughness')


def stream(config, tension_n):
    extractor = TrialFeatureExtractor(config)
    end_ns = len(tension_n) * PERIOD_NS
    for stamp_ns, phase in ((0, 'glide'), (end_ns - 1, 'done')):
        extractor.add_event(TrialEvent(stamp_ns, 't', '', 'texture', 'flexion', '', phase))
    return extractor.add_block(StrainBlock(0, 0, PERIOD_NS, tension_n)) + extractor.finish()


def test_features_of_stream_and_arrays_are_equal(roughness):
    assert list_feature_sets('glide')[-1] == 'roughness'
    assert 'roughness' not in list_feature_sets('hold')
    check_feature_set(find_feature_set('roughness'), roughness)
    tension_n = np.random.default_rng(1).normal(5.0, 1.0, 300)
    (window,) = stream(roughness, tension_n)
    assert (window.outcome, window.feature_set) == (WindowOutcome.OK, 'roughness')
    first = np.searchsorted(np.arange(300) * PERIOD_NS, 600_000_000)
    part = tension_n[first : first + 120]
    values, spec = features_from_trials('texture', part[None], RATE_HZ, config=roughness)
    assert values[0].tobytes() == window.values.tobytes()
    assert window.values == pytest.approx([part.std(), np.ptp(part)])
    assert spec.mismatch(spec_for('texture', roughness)) is None
    assert window.specification_digest == spec_for('texture', roughness).digest
    # A feature node can compute a feature set whose specification a model states.
    spec = spec_for('texture', roughness)
    assert spec_for('texture', FeatureConfig(**spec.config_values())) == spec
    extractor = TrialFeatureExtractor(FeatureConfig(), [spec])
    assert spec in extractor.specifications
    assert 'feature set' in spec.mismatch(spec_for('texture', FeatureConfig(rate_hz=RATE_HZ)))


def test_model_with_an_own_set_works_and_is_refused_if_the_set_is_not_installed(
    roughness, tmp_path, monkeypatch
):
    x = np.random.default_rng(0).normal(size=(40, 1, 120))
    x *= np.repeat([1.0, 3.0], 20)[:, None, None]
    labels = np.repeat(['smooth', 'rough'], 20)
    table = table_from_trials('texture', x, labels, RATE_HZ, config=roughness)
    assert (table.task, table.spec.names) == ('texture', ('tension__rms', 'tension__range'))
    path = tmp_path / 'model.npz'
    model = write_model(path, train(table, 'knn'))
    model.set_specifications([spec_for('texture', roughness)])
    (window,) = stream(roughness, np.random.default_rng(2).normal(5.0, 3.0, 300))
    assert model.accepts(window)
    assert model.find_mismatch(window) is None
    assert model.classify_window(window).label == 'rough'
    longer = dataclasses.replace(roughness, texture_samples=180)
    with pytest.raises(ModelFileError, match='window in samples'):
        model.check_fits(spec_for('texture', longer))

    monkeypatch.setattr(sys, 'path', [p for p in sys.path if p != str(tmp_path / 'site')])
    find_feature_set.cache_clear()
    with pytest.raises(ModelFileError, match='"roughness" is not installed'):
        load_model(path)


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('other', 'roughness:Roughness'),
        ('gone', 'no_such_module:Set'),
        ('list', 'builtins:list'),
    ],
)
def test_entry_point_that_is_not_a_feature_set_is_refused(monkeypatch, tmp_path, name, value):
    install(monkeypatch, tmp_path / 'site', value, name)
    with pytest.raises(FeatureError, match=value):
        FeatureConfig(texture_features=name)


@pytest.mark.parametrize('parameter', ['texture_features', 'stiffness_features'])
def test_set_of_another_phase_or_unknown_set_is_refused(parameter):
    wrong = {'texture_features': 'stiffness_regression', 'stiffness_features': 'texture_spatial'}
    for name in (wrong[parameter], 'nobodys'):
        with pytest.raises(FeatureError, match=f'{parameter} is "{name}"; it must be'):
            FeatureConfig(**{parameter: name})
