# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile calibrate` on a simulated load cell with a known truth, over a real pty."""

import io
import json

import pytest
import yaml

from tactile_lab.commands.calibrate import measure, run_calibrate
from tactile_lab.commands.output import Output
from tactile_lab.commands.rig_requests import CalibrateRequest
from tactile_lab.devices.load_cell_fit import fit_load_cell
from tactile_ros.errors import TactileError
from tactile_sim.devices.weight_stand import WeightStand
from tendon_sensor_driver.records import TendonSensorConfig

GRAVITY = 9.81


def request(**changes):
    values = {'weights': '0,0.5,1', 'gravity_m_s2': GRAVITY, 'down': False, 'simulated': True}
    return CalibrateRequest(**{**values, **changes})


def test_the_truth_of_a_simulated_load_cell_is_found_and_written(tmp_path, capsys):
    path = tmp_path / 'params.yaml'
    path.write_text('tendon_sensor:\n  ros__parameters:\n    rate_hz: 60.0  # mine\n')
    run_calibrate(request(params=path), as_json=True)
    found = json.loads(capsys.readouterr().out)
    assert found['simulated'] is True
    # Noise of a mean is 0.5 mN; the line is uncertain by some mN in 10 N.
    assert found['scale'] == pytest.approx(1.03, abs=5e-3)
    assert found['offset_n'] == pytest.approx(-0.2, abs=0.02)
    assert found['largest_residual_n'] < 0.02
    text = path.read_text()
    assert 'rate_hz: 60.0  # mine' in text
    parameters = yaml.safe_load(text)['tendon_sensor']['ros__parameters']
    assert TendonSensorConfig(**parameters).scale == found['scale']
    assert parameters['offset_n'] == found['offset_n']


def test_hysteresis_of_a_simulated_load_cell_is_seen():
    with WeightStand(scale=-2.0, offset_n=0.1, hysteresis_n=0.2, seed=2) as stand:
        readings = measure(
            TendonSensorConfig(port=stand.port),
            (0.0, 0.5, 1.0),
            lambda mass_kg: stand.hang(mass_kg * GRAVITY),
            Output(as_json=True),
            goes_down=True,
        )
    assert [reading.is_rising for reading in readings] == [True, True, True, False, False]
    found = fit_load_cell(readings, GRAVITY)
    assert found.hysteresis_n == pytest.approx(0.2, abs=0.02)
    assert found.scale == pytest.approx(-2.0, rel=0.02)


def test_what_cannot_be_calibrated_is_refused(tmp_path, monkeypatch):
    path = tmp_path / 'params.yaml'
    path.write_text('tendon_sensor:\n  ros__parameters:\n    sensor: net_ft\n')
    with pytest.raises(TactileError, match='calibration of its maker'):
        run_calibrate(request(simulated=False, params=path), as_json=True)
    with pytest.raises(TactileError, match='leave --sensor out'):
        run_calibrate(request(sensor='/dev/ttyUSB0'), as_json=True)
    monkeypatch.setattr('sys.stdin', io.StringIO(''))
    with WeightStand() as stand, pytest.raises(TactileError, match='standard input has ended'):
        run_calibrate(request(simulated=False, sensor=stand.port), as_json=True)
