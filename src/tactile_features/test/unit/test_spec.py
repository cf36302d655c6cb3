# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import hashlib
import json
import re

import pytest

from tactile_features import FeatureConfig, FeatureError, FeatureSpec, spec_for
from tactile_features.spec import array_spec, format_rates, shared_rate_hz

WAYS = [
    {'spectrum_detrend': detrend, 'spectrum_window': window}
    for detrend in ('none', 'mean', 'linear')
    for window in ('none', 'hann')
]


def make_spec(task, **config):
    return spec_for(task, FeatureConfig(**config))


def test_the_features_of_each_task():
    spec = make_spec('texture')
    assert (spec.feature_set, spec.version, spec.rate_hz) == ('texture_spectrum', 2, 60.0)
    assert (spec.sample_count, len(spec.names), spec.units) == (180, 91, ('N',) * 91)
    spec = make_spec('stiffness')
    assert (spec.feature_set, spec.version, spec.rate_hz) == ('stiffness_regression', 2, 60.0)
    assert (spec.sample_count, spec.units) == (0, ('N/s', 'N', '1'))


def test_names_are_distinct_in_the_longest_window_that_a_config_allows():
    names = make_spec('texture', rate_hz=1000.0, texture_samples=59_900, buffer_s=600.0).names
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (lambda d: d.pop('names'), "no entry 'names'"),
        (lambda d: d.update(rate_hz='fast'), 'cannot be read'),
        (lambda d: d.update(rate_hz=10**400), 'cannot be read'),
        (lambda d: d.update(rate_hz=float('inf')), 'rate_hz is inf'),
        (lambda d: d.update(rate_hz=-60.0), 'rate_hz is -60'),
        (lambda d: d.update(version=float('inf')), 'cannot be read'),
        (lambda d: d['parameters'].update(max_gap_samples=10**400), 'cannot be read'),
        (lambda d: d['parameters'].update(max_gap_samples=0.5), 'max_gap_samples is 0.5'),
        (lambda d: d['parameters'].update(max_gap_samples=float('nan')), 'max_gap_samples'),
        (lambda d: d.update(parameters=[1]), 'cannot be read'),
        (lambda d: d.update(names=3), 'cannot be read'),
    ],
)
def test_a_damaged_specification_is_refused(change, message):
    data = make_spec('texture').to_dict()
    change(data)
    with pytest.raises(FeatureError, match=message):
        FeatureSpec.from_dict(data)


@pytest.mark.parametrize(
    ('change', 'what'),
    [
        ({'feature_set': 'texture_wavelets'}, 'feature set'),
        ({'version': 99}, 'version'),
        ({'rate_hz': 120.0}, 'rate'),
        ({'sample_count': 360}, 'window in samples'),
        (
            {'parameters': {'texture_crop_start_s': 0.5, 'spectrum_detrend': 'linear'}},
            r'window \(texture_crop_start_s\)',
        ),
        (
            {'parameters': {'texture_crop_start_s': 0.6, 'spectrum_window': 'hann'}},
            r'window \(spectrum_window\)',
        ),
        ({'names': ('a',) * 91}, 'names'),
        ({'units': ('mN',) * 91}, 'units'),
    ],
)
def test_a_mismatch_names_what_differs(change, what):
    spec = make_spec('texture')
    other = dataclasses.replace(spec, **change)
    assert spec.mismatch(spec) is None
    for reason in (spec.mismatch(other), other.mismatch(spec)):
        assert 'differ' in reason
        assert re.search(what, reason)


def test_ready_cut_windows_fit_whatever_they_were_cut_from():
    for task, sample_count in (('texture', 180), ('stiffness', 240)):
        spec = array_spec(task, sample_count, 60.0)
        options = WAYS[-2] if task == 'texture' else {}
        assert spec.parameters == options
        assert spec.mismatch(make_spec(task)) is None
        assert make_spec(task).mismatch(spec) is None
    assert 'window' in array_spec('texture', 181, 60.0).mismatch(make_spec('texture'))
    assert 'rate' in array_spec('stiffness', 240, 80.0).mismatch(make_spec('stiffness'))


SPATIAL = {'texture_features': 'texture_spatial'}


@pytest.mark.parametrize(
    ('task', 'fields'),
    [
        ('texture', {'rate_hz': 100.0, 'texture_samples': 90, 'texture_crop_start_s': 0.2}),
        *(('texture', way) for way in WAYS),
        (
            'texture',
            {
                **SPATIAL,
                'spatial_crop_m': 0.003,
                'spatial_length_m': 0.03,
                'spatial_finest_m': 0.001,
            },
        ),
        ('texture', {'texture_features': 'glide_waveform'}),
        ('texture', {'texture_features': 'spatial_waveform'}),
        ('stiffness', {'stiffness_features': 'hold_waveform', 'stiffness_samples': 120}),
        ('stiffness', {'stiffness_settle_s': 0.75, 'stiffness_crop_end_s': 0.2}),
    ],
)
def test_a_specification_survives_json_and_gives_the_config_that_yields_it(task, fields):
    spec = make_spec(task, **fields)
    again = FeatureSpec.from_dict(json.loads(json.dumps(spec.to_dict())))
    assert (again, again.digest) == (spec, spec.digest)
    assert make_spec(task, **spec.config_values()) == spec
    if fields not in WAYS[-2:-1]:  # these are not the default parameters
        assert spec.digest != make_spec(task).digest


def test_a_specification_sets_what_windows_depend_on_and_nothing_else():
    odd = dataclasses.replace(make_spec('stiffness'), parameters={'buffer_s': 600.0})
    assert odd.config_values() == {
        'rate_hz': 60.0,
        'stiffness_features': 'stiffness_regression',
    }
    assert set(array_spec('texture', 90, 50.0).config_values()) == {
        'rate_hz',
        'texture_features',
        'texture_samples',
        'early_windows',
        'spectrum_detrend',
        'spectrum_window',
    }


@pytest.mark.parametrize(
    ('fields', 'message'),
    [
        ({**SPATIAL, 'spatial_length_m': 0.001}, 'finest scale'),
        ({'rate_hz': 0.0}, 'rate_hz is 0.0'),
        ({'rate_hz': float('nan')}, 'rate_hz is nan'),
        ({'texture_samples': 1}, 'texture_samples is 1'),
        ({'max_gap_samples': -1}, 'max_gap_samples'),
        ({'texture_samples': 7200}, 'raise buffer_s'),
        ({'stiffness_min_s': 5.0, 'buffer_s': 5.0}, 'raise buffer_s'),
    ],
)
def test_a_config_that_cannot_work_is_refused(fields, message):
    with pytest.raises(FeatureError, match=message):
        FeatureConfig(**fields)


def test_the_digest_is_of_the_canonical_text():
    text = (
        '{"feature_set":"stiffness_regression","names":["tension__regression__slope",'
        '"tension__regression__intercept","tension__regression__correlation"],"parameters":'
        '{"max_gap_samples":0.0,"stiffness_crop_end_s":0.1,"stiffness_settle_s":0.5},'
        '"rate_hz":60.0,"sample_count":0,"units":["N/s","N","1"],"version":2}'
    )
    digest = hashlib.sha256(text.encode()).hexdigest()[:16]
    assert make_spec('stiffness').digest == digest == 'ef496bae651687be'


def test_equal_numbers_give_one_digest():
    spec = make_spec('stiffness', stiffness_settle_s=0.0, stiffness_crop_end_s=1.0)
    # The specification is changed directly, because equal configurations share a cached one.
    equal = {**spec.parameters, 'stiffness_settle_s': -0.0, 'stiffness_crop_end_s': 1}
    assert dataclasses.replace(spec, parameters=equal).digest == spec.digest
    assert type(make_spec('texture', rate_hz=61).rate_hz) is float


@pytest.mark.parametrize(
    ('task', 'base', 'names'),
    [
        (
            'texture',
            {},
            {'rate_hz', 'texture_samples', 'texture_crop_start_s', 'max_gap_samples'},
        ),
        (
            'texture',
            SPATIAL,
            {'rate_hz', 'spatial_crop_m', 'spatial_length_m', 'spatial_finest_m'}
            | {'max_gap_samples'},
        ),
        (
            'stiffness',
            {},
            {'rate_hz', 'stiffness_settle_s', 'stiffness_crop_end_s', 'max_gap_samples'},
        ),
    ],
)
def test_each_parameter_that_changes_a_value_changes_the_digest(task, base, names):
    config = FeatureConfig(**base)
    digest = spec_for(task, config).digest
    changed = set()
    for field in dataclasses.fields(FeatureConfig):
        value = getattr(config, field.name)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            low, high = field.metadata['range']
            other = value * 1.125 if isinstance(value, float) else value + 1
            assert low <= other <= high
            another = dataclasses.replace(config, **{field.name: other})
            if spec_for(task, another).digest != digest:
                changed.add(field.name)
    assert changed == names


def test_the_channel_is_part_of_the_specification():
    alone = array_spec('texture', 180, 60.0)
    of = {
        channel: dataclasses.replace(alone, channel=channel, channels=('fx', 'fy'))
        for channel in ('fx', 'fy', 'mean', 'all')
    }
    assert len({alone.digest, *(spec.digest for spec in of.values())}) == 5
    for spec in (alone, *of.values()):
        assert FeatureSpec.from_dict(json.loads(json.dumps(spec.to_dict()))) == spec
        assert alone.mismatch(spec) == spec.mismatch(alone) is None
    assert of['fx'].mismatch(of['mean']) == 'the channel differs: required fx, found mean'
    more = {
        channel: dataclasses.replace(spec, channels=('fx', 'fy', 'fz'))
        for channel, spec in of.items()
    }
    assert more['fx'].digest == of['fx'].digest
    assert more['fx'].mismatch(of['fx']) is None
    assert more['mean'].digest != of['mean'].digest
    assert more['mean'].mismatch(of['mean']) == (
        'the list of channels differs: required fx, fy, fz, found fx, fy'
    )
    assert more['fx'].describe_channel() == 'fx; not used: fy, fz'
    assert more['all'].describe_channel() == 'all of 3 (fx, fy, fz)'
    assert alone.describe_channel() == ''
    damaged = {**of['fx'].to_dict(), 'channel': 'fz'}
    with pytest.raises(FeatureError, match='channel is "fz"'):
        FeatureSpec.from_dict(damaged)


def test_rates_that_stamps_cannot_tell_apart_are_the_same():
    specs = [array_spec('texture', 180, rate_hz) for rate_hz in (60.0, 60.05, 60.07)]
    assert specs[0].mismatch(specs[1]) == specs[1].mismatch(specs[0]) is None
    assert specs[0].mismatch(specs[2]) == 'the rate in Hz differs: required 60, found 60.07'
    precise = [array_spec('texture', 180, rate_hz) for rate_hz in (1000.0001, 1002.0003)]
    assert precise[0].mismatch(precise[1]) == 'the rate in Hz differs: required 1000, found 1002'
    assert format_rates(100.0, 100.00000001) == ('100', '100.00000001')
    assert shared_rate_hz(specs[:2]) == 60.0
    assert shared_rate_hz(specs) == 0.0
    fewer = dataclasses.replace(specs[1], names=specs[1].names[:9], units=('N',) * 9)
    assert specs[0].mismatch(fewer) == 'the names or units of the features differ'


def test_a_specification_of_the_only_channel_says_nothing_of_channels():
    spec = array_spec('stiffness', 240, 60.0)
    assert not {'channel', 'channels'} & set(spec.to_dict())
    assert spec.digest == '0ef242ef6e5156ab'
