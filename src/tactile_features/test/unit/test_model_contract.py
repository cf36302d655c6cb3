# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The features that model files require are read without loading the models."""

import dataclasses

import pytest

from tactile_features import (
    FeatureConfig,
    FeatureError,
    read_contracts,
    spec_for,
    TrialFeatureExtractor,
)
from tactile_features.errors import ModelFileError
from tactile_features.model_container import MAX_MODEL_BYTES
from tactile_features.model_contract import plan_features
from tactile_features.spec import array_spec

FULL = spec_for('texture', FeatureConfig())
SHORT = spec_for('texture', FeatureConfig(texture_samples=90, max_gap_samples=2))
HOLD = spec_for('stiffness', FeatureConfig())


@pytest.fixture
def folder(tmp_path, make_model_file):
    make_model_file(tmp_path / 'one.npz', FULL)
    make_model_file(tmp_path / 'other.npz', SHORT, 'abduction')
    make_model_file(tmp_path / 'third.npz', HOLD, '')
    return tmp_path


def test_a_folder_gives_what_each_file_states(folder):
    contracts, refused = read_contracts(folder)
    assert refused == []
    assert [(c.task, c.contact, c.spec) for c in contracts] == [
        ('texture', 'flexion', FULL),
        ('texture', 'abduction', SHORT),
        ('stiffness', '', HOLD),
    ]


def test_a_contact_leaves_out_the_models_of_another(folder):
    contracts, refused = read_contracts(str(folder), 'flexion')
    assert ([c.spec for c in contracts], refused) == ([FULL, HOLD], [])
    assert read_contracts(folder / 'one.npz', 'flexion')[0] == contracts[:1]
    with pytest.raises(ModelFileError, match=r'abduction.* contact is flexion'):
        read_contracts(folder / 'other.npz', 'flexion')


@pytest.mark.parametrize(
    ('changes', 'named'),
    [
        ({'format_version': 5}, 'version 5'),
        ({'task': 3}, '"task"'),
        ({'task': 'stiffness'}, 'task "stiffness"'),
        ({'contact': 'thumb'}, 'contact is "thumb"'),
        ({'specification_digest': '0' * 16}, ''),
    ],
    ids=str,
)
def test_a_file_that_is_refused_is_named_and_the_others_count(
    folder, make_model_file, changes, named
):
    make_model_file(folder / 'broken.npz', FULL, **changes)
    contracts, (refused,) = read_contracts(folder)
    assert len(contracts) == 3
    assert str(folder / 'broken.npz') in refused
    assert named in refused
    with pytest.raises(ModelFileError) as caught:
        read_contracts(folder / 'broken.npz')
    assert str(caught.value) == refused


@pytest.mark.parametrize(
    ('changes', 'named'),
    [
        ({'version': 1}, 'version .*1.* 2'),
        ({'feature_set': 'smell'}, '"smell"'),
        ({'names': FULL.names[:-1]}, 'names'),
        ({'rate_hz': 0.5}, 'rate_hz is 0.5'),
        ({'sample_count': 10**7}, 'texture_samples is 10000000'),
        ({'texture_crop_start_s': 'late'}, 'texture_crop_start_s'),
        ({'spectrum_detrend': 1.0}, 'spectrum_detrend'),
        ({'smell': 1.0}, 'smell'),
    ],
    ids=str,
)
def test_features_that_cannot_be_computed_here_refuse_the_file(
    tmp_path, make_model_file, changes, named
):
    fields = {name: value for name, value in changes.items() if hasattr(FULL, name)}
    parameters = {name: value for name, value in changes.items() if name not in fields}
    fields['parameters'] = {**FULL.parameters, **parameters}
    spec = dataclasses.replace(FULL, **fields)
    path = make_model_file(tmp_path / 'm.npz', spec, task='texture')
    with pytest.raises(ModelFileError, match=f'm.npz .*{named}'):
        read_contracts(path)


def test_what_is_no_model_is_refused(tmp_path):
    path = tmp_path / 'm.npz'
    for missing in (tmp_path, path):
        with pytest.raises(ModelFileError, match=str(missing)):
            read_contracts(missing)
    with path.open('wb') as file:
        file.truncate(MAX_MODEL_BYTES + 1)
    with pytest.raises(ModelFileError, match='64 MiB'):
        read_contracts(tmp_path)
    for i in range(9):
        (tmp_path / f'{i}.npz').write_bytes(b'hello')
    with pytest.raises(ModelFileError, match=r'; and 5 more$'):
        read_contracts(tmp_path)


def test_a_plan_names_what_the_models_decide_otherwise_than_the_parameters(folder):
    assert plan_features(FeatureConfig(), '').specs == ()
    plan = plan_features(FeatureConfig(), folder)
    assert (plan.specs, plan.refused, plan.overruled) == ((FULL, SHORT, HOLD), (), ())
    config = FeatureConfig(texture_samples=240, stiffness_settle_s=1.0, samples_timeout_s=9)
    assert plan_features(config, folder).overruled == (
        'texture_samples 180 and 90 (not 240)',
        'stiffness_settle_s 0.5 (not 1.0)',
    )


def test_a_model_beyond_the_limits_of_the_node_is_refused(folder, make_model_file):
    long = FeatureConfig(texture_samples=900, buffer_s=60.0)
    make_model_file(folder / 'long.npz', spec_for('texture', long))
    assert len(plan_features(FeatureConfig(), folder).specs) == 4
    plan = plan_features(FeatureConfig(buffer_s=10.0), folder)
    assert len(plan.specs) == 3
    assert 'long.npz is refused: buffer_s is 10' in plan.refused[0]


def test_ready_cut_windows_are_cut_by_the_parameters_of_the_node():
    wanted = array_spec('texture', 120, 60.0)
    config = FeatureConfig(texture_crop_start_s=0.9, max_gap_samples=1)
    (glide, _) = TrialFeatureExtractor(config, [wanted]).specifications
    assert glide == spec_for('texture', dataclasses.replace(config, texture_samples=120))
    # Equal specifications are listed once.
    found = TrialFeatureExtractor(config, [glide, wanted]).specifications
    assert found[0] == glide
    assert len(found) == 2


def test_a_phase_that_no_model_wants_has_the_window_of_the_parameters_at_the_common_rate():
    fast = spec_for('texture', FeatureConfig(rate_hz=100.0))
    config = FeatureConfig(stiffness_settle_s=1.0)
    extractor = TrialFeatureExtractor(config, [fast])
    own = dataclasses.replace(config, rate_hz=100.0)
    assert extractor.config == own
    assert extractor.specifications == (fast, spec_for('stiffness', own))
    assert TrialFeatureExtractor(config, [fast, FULL]).config == config


def test_early_windows_of_a_set_without_a_first_part_are_refused():
    forged = dataclasses.replace(HOLD, parameters={**HOLD.parameters, 'early_windows': 1.0})
    with pytest.raises(FeatureError, match='early_windows'):
        TrialFeatureExtractor(FeatureConfig(), [forged])
