# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feature sets as scikit-learn transformers."""

import subprocess
import sys

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.utils.estimator_checks import parametrize_with_checks

import tactile_features
from tactile_features.config import FeatureConfig
from tactile_features.estimators import (
    FeatureTransformer,
    GlideWaveform,
    HoldWaveform,
    SpatialWaveform,
    StiffnessRegression,
    StiffnessRelaxation,
    TextureSpatial,
    TextureSpectrum,
)
from tactile_features.extraction.extractor import features_from_trials
from tactile_features.feature_sets.registry import BUILT_IN, list_feature_sets
from tactile_features.types import PHASE_GLIDE, PHASE_HOLD

RATE_HZ = 60.0
OVER_TIME = [
    TextureSpectrum(),
    TextureSpectrum(detrend='none', window='hann'),
    StiffnessRegression(),
    StiffnessRelaxation(),
    GlideWaveform(),
    HoldWaveform(),
]


class OfRepeats:
    """Lengthens windows to 41 samples, as the features over distance need them.

    The windows in the checks of scikit-learn have 2 to 5 samples.
    """

    def split(self, rows):
        windows, speeds_m_s = super().split(rows)
        return np.tile(windows, (1, 41))[:, :41], speeds_m_s


class RepeatedSpatial(OfRepeats, TextureSpatial):
    pass


class RepeatedWaveform(OfRepeats, SpatialWaveform):
    pass


OVER_DISTANCE = [
    kind(speed_column=None, speed_m_s=0.015, length_m=0.01)
    for kind in (RepeatedSpatial, RepeatedWaveform)
]


@parametrize_with_checks([*OVER_TIME, *OVER_DISTANCE])
def test_transformers_pass_the_checks_of_scikit_learn(estimator, check):
    check(estimator)


def make_windows(count=7, samples=260):
    rng = np.random.default_rng(3)
    return 3.0 + rng.normal(0.0, 0.1, (count, samples)) + np.linspace(0.0, 0.2, samples)


def test_each_feature_set_has_a_transformer():
    kinds = [GlideWaveform, HoldWaveform, SpatialWaveform, StiffnessRegression]
    kinds += [StiffnessRelaxation, TextureSpatial, TextureSpectrum]
    assert {kind.feature_set for kind in kinds} == {each.name for each in BUILT_IN}
    assert {kind.__name__ for kind in kinds} == {each.__name__ for each in BUILT_IN}
    assert {kind.__name__ for kind in kinds} <= set(dir(tactile_features))


@pytest.mark.parametrize('transformer', OVER_TIME, ids=repr)
def test_features_are_those_of_the_stream(transformer):
    windows = make_windows()
    fields = {field: getattr(transformer, name) for name, field in transformer.options.items()}
    is_glide = transformer.feature_set in list_feature_sets(PHASE_GLIDE)
    chooser = 'texture_features' if is_glide else 'stiffness_features'
    config = FeatureConfig(**{chooser: transformer.feature_set, **fields})
    values, spec = features_from_trials(transformer.task, windows, RATE_HZ, config=config)
    fitted = clone(transformer).fit(windows[:2])
    assert np.array_equal(fitted.transform(windows), values)
    assert fitted.specification_ == spec
    assert fitted.get_feature_names_out().tolist() == list(spec.names)
    assert transformer.feature_set in list_feature_sets(PHASE_GLIDE if is_glide else PHASE_HOLD)


@pytest.mark.parametrize('kind', [TextureSpatial, SpatialWaveform])
def test_speeds_are_a_column_of_x_or_one_number(kind):
    windows, speeds_m_s = make_windows(), np.linspace(0.0115, 0.02, 7)
    config = FeatureConfig(texture_features=kind.feature_set)
    values, spec = features_from_trials(
        'texture', windows, RATE_HZ, config=config, speeds_m_s=speeds_m_s
    )
    for column, x in (
        (-1, np.column_stack([windows, speeds_m_s])),
        (0, np.column_stack([speeds_m_s, windows])),
    ):
        fitted = kind(speed_column=column).fit(x)
        assert np.array_equal(fitted.transform(x), values)
        assert fitted.specification_ == spec
    one = kind(speed_column=None, speed_m_s=0.0115).fit(windows)
    assert np.array_equal(one.transform(windows[:1]), values[:1])


@pytest.mark.parametrize(
    ('transformer', 'named'),
    [
        (TextureSpectrum(detrend='cubic'), 'cubic'),
        (TextureSpectrum(rate_hz=0.0), '0.0 Hz'),
        (TextureSpatial(speed_column=None), 'speed_m_s'),
        (TextureSpatial(speed_m_s=0.015), 'speed_column'),
        (TextureSpatial(speed_column=260), '260'),
        (TextureSpatial(speed_column=None, speed_m_s=0.015, length_m=0.0006), '0.0006 m'),
    ],
)
def test_parameters_are_checked_in_fit(transformer, named):
    with pytest.raises(ValueError, match=named):
        transformer.fit(make_windows())


def test_undefined_features_name_the_window():
    windows = make_windows(3)
    fitted = StiffnessRelaxation(rate_hz=1000.0).fit(windows)
    windows[1] = np.arange(260)  # the relative slope is undefined, because the intercept is 0
    with pytest.raises(ValueError, match='trial 1'):
        fitted.transform(windows)


def test_class_for_a_feature_set_of_another_package_needs_its_name_alone():
    class Unknown(FeatureTransformer):
        feature_set = 'no_such_set'

        def __init__(self, rate_hz=60.0):
            self.rate_hz = rate_hz

    with pytest.raises(ValueError, match='no_such_set'):
        Unknown().fit(make_windows())


def test_other_names_import_no_scikit_learn():
    code = (
        'import sys, tactile_features as f\n'
        "[getattr(f, name) for name in f.__all__ if f._HOMES[name] != '.estimators']\n"
        "assert 'sklearn' not in sys.modules"
    )
    subprocess.run([sys.executable, '-c', code], check=True)
