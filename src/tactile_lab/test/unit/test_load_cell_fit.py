# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The fit of a load cell's calibration is exact, and unusable readings are refused."""

from fractions import Fraction
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import yaml

from tactile_lab.commands.calibrate import parse_weights
from tactile_lab.devices.load_cell import (
    CalibrationError,
    edit_parameters,
    fit_load_cell,
    set_parameters,
    settled_mean,
    WeightReading,
)
from tactile_ros.errors import TactileError


def readings(masses, values, rising=None):
    rising = rising or [True] * len(masses)
    return [WeightReading(m, v, 0.0, up) for m, v, up in zip(masses, values, rising, strict=True)]


def exact_fit(masses, values, gravity):
    """Return scale, offset and sum of squared residuals [N^2] in rational arithmetic."""
    x = [Fraction(float(m * gravity)) for m in masses]
    y = [Fraction(v) for v in values]
    n = len(x)
    x_mean, y_mean = sum(x) / n, sum(y) / n
    slope = sum((a - x_mean) * (b - y_mean) for a, b in zip(x, y, strict=True)) / sum(
        (a - x_mean) ** 2 for a in x
    )
    cut = y_mean - slope * x_mean
    squares = sum(((b - cut) / slope - a) ** 2 for a, b in zip(x, y, strict=True))
    return 1 / slope, -cut / slope, squares, sum((a - x_mean) ** 2 for a in x), x_mean


@pytest.mark.parametrize(
    ('masses', 'values'),
    [
        ([0.0, 0.2, 0.5, 1.0], [0.2, 2.13, 5.04, 9.89]),
        ([0.0, 0.5, 1.0], [1e6, 1e6 + 4.9, 1e6 + 9.8]),  # a large offset
        ([0.0, 1e-3, 2e-3], [0.0, 0.0098, 0.0197]),
        ([0.0, 0.5, 1.0, 2.0], [0.3, -4.6, -9.4, -19.3]),  # reversed polarity
    ],
)
def test_line_equals_the_fit_in_exact_arithmetic(masses, values):
    scale, offset, squares, width, middle = exact_fit(masses, values, 9.81)
    found = fit_load_cell(readings(masses, values), 9.81)
    assert found.scale == pytest.approx(float(scale), rel=1e-9)
    assert found.offset_n == pytest.approx(float(offset), rel=1e-9, abs=1e-12)
    sigma = math.sqrt(squares / (len(masses) - 2))
    assert found.scale_error == pytest.approx(
        abs(float(scale)) * sigma / math.sqrt(width), rel=1e-5
    )
    cut = math.sqrt(Fraction(1, len(masses)) + middle**2 / width)
    assert found.offset_error_n == pytest.approx(sigma * cut, rel=1e-5)


def test_uncertainties_have_the_stated_coverage():
    """About 68 % of many calibrations with noise are within one standard uncertainty."""
    generator = np.random.default_rng(3)
    masses = np.array([0.0, 0.2, 0.5, 1.0, 1.5, 2.0, 1.5, 1.0, 0.5, 0.2, 0.0])
    hits = 0
    for _ in range(400):
        values = (masses * 9.81 + 0.2) / 1.03 + generator.normal(0.0, 0.01, masses.size)
        found = fit_load_cell(readings(masses, values), 9.81)
        hits += abs(found.scale - 1.03) <= found.scale_error
    # Student's t distribution with nine degrees of freedom has 65.7 % within one standard error.
    assert abs(hits / 400 - 0.657) < 5 * math.sqrt(0.657 * 0.343 / 400)


def test_hysteresis_is_the_largest_difference_between_both_directions():
    masses, rising = [0.0, 0.5, 1.0, 0.5, 0.0], [True, True, True, False, False]
    found = fit_load_cell(readings(masses, [0.0, 2.0, 4.0, 2.1, 0.02], rising), 9.80665)
    assert found.hysteresis_n == pytest.approx(abs(found.scale) * 0.1, rel=1e-12)
    assert fit_load_cell(readings([0, 1, 2], [0.0, 1.0, 2.0]), 9.8).hysteresis_n is None


@pytest.mark.parametrize(
    ('masses', 'values', 'sentence'),
    [
        ([0.0, 1.0], [0.0, 9.8], '2 different weights'),
        ([0.0, 1.0, 1.0, 0.0], [0.0, 9.8, 9.8, 0.0], '2 different weights'),
        ([0.0, 1.0, 2.0], [0.0, 9.8, 5.0], 'from 1 to 2 kg'),
        ([0.0, 1.0, 2.0], [0.0, -9.8, -9.8], 'wrong direction'),
        ([0.0, 1.0, 2.0], [0.0, 0.0, 0.0], 'wrong direction'),
    ],
)
def test_readings_without_a_valid_line_are_refused(masses, values, sentence):
    with pytest.raises(CalibrationError, match=sentence):
        fit_load_cell(readings(masses, values), 9.81)


def test_second_is_at_rest_if_the_weight_does_not_swing():
    generator = np.random.default_rng(1)
    noise = generator.normal(0.0, 0.004, 60)
    mean, deviation = settled_mean(5.0 + noise)
    assert mean == pytest.approx(5.0, abs=0.003)
    assert deviation == pytest.approx(0.004, rel=0.4)
    time_s = np.arange(60) / 60
    assert settled_mean(5.0 + noise + 0.05 * time_s) is None
    assert settled_mean(5.0 + noise + 0.5 * np.sin(20 * time_s)) is None
    with_spike = 5.0 + noise
    with_spike[30] = 40.0
    assert settled_mean(with_spike)[0] == pytest.approx(5.0, abs=0.003)
    assert settled_mean(np.full(60, 5.0)) == (5.0, 0.0)
    assert settled_mean([1.0, math.nan, 1.0, 1.0]) is None


@pytest.mark.parametrize('text', ['', '1,x', '0,1', '0,1,-2', '0,1,nan', '0,0,1'])
def test_invalid_weights_are_refused(text):
    with pytest.raises(CalibrationError, match='--weights'):
        parse_weights(text)
    assert parse_weights('1,0, 0.5') == (0.0, 0.5, 1.0)


FILE = """\
# My rig.
tendon_sensor:
  ros__parameters:
    port: /dev/ttyUSB0   # the blue one
    scale: 1.5  # by eye
linear_guide: {ros__parameters: {port: /dev/ttyACM0}}
"""


def test_parameters_are_set_and_the_rest_of_the_file_is_kept(tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_text(FILE)
    set_parameters(path, 'tendon_sensor', {'scale': 1.03, 'offset_n': -0.2})
    expected = FILE.replace('scale: 1.5', 'scale: 1.03').replace(
        '    port: /dev/ttyUSB0', '    offset_n: -0.2\n    port: /dev/ttyUSB0'
    )
    assert path.read_text() == expected
    set_parameters(tmp_path / 'new.yaml', 'tendon_sensor', {'scale': 2.0})
    assert (tmp_path / 'new.yaml').read_text() == (
        'tendon_sensor:\n  ros__parameters:\n    scale: 2.0\n'
    )
    assert sorted(each.name for each in tmp_path.iterdir()) == ['new.yaml', 'params.yaml']


@pytest.mark.parametrize(
    'text',
    ['- 1', 'tendon_sensor: 3', 'tendon_sensor: {ros__parameters: [1]}', 'a: &b {c: 1}\nd: *b'],
)
def test_file_that_is_no_parameter_file_is_not_changed(tmp_path, text):
    path = tmp_path / 'params.yaml'
    path.write_text(text)
    with pytest.raises(TactileError, match=r'params\.yaml'):
        set_parameters(path, 'tendon_sensor', {'scale': 1.0})
    assert path.read_text() == text


NAMES = st.sampled_from(['scale', 'offset_n', 'port', 'tendon_sensor', '/tendon_sensor', 'other'])
VALUES = st.recursive(
    st.integers() | st.sampled_from(['a', 'on', '', 'x: y']) | st.booleans(),
    lambda below: st.dictionaries(NAMES | st.just('ros__parameters'), below, max_size=3),
    max_leaves=6,
)


@given(st.dictionaries(NAMES, VALUES, max_size=3), st.booleans())
def test_only_these_values_change_in_any_file_or_it_is_refused(document, flow):
    text = yaml.safe_dump(document, default_flow_style=flow)
    try:
        new = yaml.safe_load(edit_parameters(text, 'tendon_sensor', {'scale': 0.1}))
    except TactileError:
        return
    key = next((k for k in document if k.strip('/') == 'tendon_sensor'), 'tendon_sensor')
    parameters = new[key]['ros__parameters']
    assert parameters.pop('scale') == 0.1
    old = (document.get(key) or {}).get('ros__parameters') or {}
    assert parameters == {k: v for k, v in old.items() if k != 'scale'}
    assert {k: v for k, v in new.items() if k != key} == {
        k: v for k, v in document.items() if k != key
    }
