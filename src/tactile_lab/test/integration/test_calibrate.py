# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile calibrate` on a simulated load cell with known parameters, over a real pty."""

from concurrent.futures import ThreadPoolExecutor
import io
import json

import numpy as np
import pytest
import yaml

from tactile_lab.commands import calibrate as module
from tactile_lab.commands.calibrate import calibrate
from tactile_ros.errors import TactileError
from tactile_ros.strain import StrainBlock
from tactile_sim import pty_server
from tactile_sim.pty_server import WeightStand
from tactile_testing.waiting import wait_until
from tendon_sensor_driver.config import TendonSensorConfig

GRAVITY = 9.81


def run(**changes):
    values = {'weights': '0,0.5,1', 'gravity_m_s2': GRAVITY, 'simulated': True}
    calibrate(**{**values, **changes}, as_json=True)


def test_calibration_of_a_simulated_load_cell_is_correct_and_written_to_the_file(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(module, 'SETTLED_S', 0.5)
    monkeypatch.setattr(
        pty_server, 'WeightStand', lambda seed: WeightStand(seed=seed, hysteresis_n=0.2)
    )
    path = tmp_path / 'params.yaml'
    path.write_text('tendon_sensor:\n  ros__parameters:\n    rate_hz: 60.0  # mine\n')
    run(params=path)
    found = json.loads(capsys.readouterr().out)
    assert found['simulated'] is True
    assert [r['is_rising'] for r in found['readings']] == [True, True, True, False, False]
    # The noise of a mean is 0.7 mN. The true values are 1.03 and -0.2 N. Hysteresis of the
    # readings with decreasing weights changes the least-squares line to the following values.
    assert found['hysteresis_n'] == pytest.approx(0.2, abs=0.02)
    assert found['scale'] == pytest.approx(1.039, abs=5e-3)
    assert found['offset_n'] == pytest.approx(-0.317, abs=0.02)
    text = path.read_text()
    assert 'rate_hz: 60.0  # mine' in text
    parameters = yaml.safe_load(text)['tendon_sensor']['ros__parameters']
    assert TendonSensorConfig(**parameters).scale == found['scale']
    assert parameters['offset_n'] == found['offset_n']


def test_late_sample_of_the_previous_weight_is_ignored():
    listener = module._Listener(TendonSensorConfig())

    def feed(at_ns, tension_n):
        listener.take(StrainBlock(at_ns, 0, 1, np.full(60, tension_n)))

    with ThreadPoolExecutor() as pool:
        found = pool.submit(listener.wait_settled, 0.5)
        began_ns = wait_until(lambda: listener._since_ns)

        def feed_both():
            feed(began_ns - 1, 1.0)
            feed(began_ns, 2.0)

        wait_until(found.done, step=feed_both)
    assert found.result() == (2.0, 0.0)


def test_sensors_that_cannot_be_calibrated_are_refused(tmp_path, monkeypatch):
    path = tmp_path / 'params.yaml'
    given = (
        'sensor: net_ft\n    use_sim_time: false\n'  # use_sim_time is a parameter of every node
    )
    path.write_text(f'tendon_sensor:\n  ros__parameters:\n    {given}')
    with pytest.raises(TactileError, match='calibrated by its manufacturer'):
        run(simulated=False, params=path)
    with pytest.raises(TactileError, match='omit --sensor'):
        run(sensor='/dev/ttyUSB0')
    monkeypatch.setattr('sys.stdin', io.StringIO(''))
    with WeightStand() as stand, pytest.raises(TactileError, match='standard input has ended'):
        run(simulated=False, sensor=stand.port)
