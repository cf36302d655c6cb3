# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile calibrate`: calibrate a load cell with known weights."""

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from itertools import pairwise
import math
from pathlib import Path
import sys
import threading
import time
from typing import Annotated, Optional, TYPE_CHECKING

import typer

from tactile_lab import options
from tactile_lab.console import Table
from tactile_lab.output import Output
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_lab.devices.load_cell import LoadCellFit, WeightReading
    from tactile_ros.strain import StrainBlock
    from tendon_sensor_driver.config import TendonSensorConfig

NODE = 'tendon_sensor'

SETTLED_S = 1.0
"""Time over which a reading is averaged [s]."""

SETTLE_TIMEOUT_S = 20.0
"""Longest time to wait until a weight is at rest [s]."""


def calibrate(
    weights: Annotated[
        str, typer.Option(help='Known masses [kg], separated by commas, at least 3: 0,0.2,0.5,1.')
    ],
    sensor: options.SensorOption = '',
    params: Annotated[
        Optional[Path],
        typer.Option(
            help='YAML file with ROS parameters, in which `scale` and `offset_n` of '
            '`tendon_sensor` are changed. Default: print only.'
        ),
    ] = None,
    gravity_m_s2: Annotated[
        float,
        typer.Option('--g', min=9.7, max=9.9, help='Local acceleration of gravity [m/s^2].'),
    ] = 9.80665,
    down: Annotated[
        bool, typer.Option(help='Also measure decreasing weights, which shows hysteresis.')
    ] = True,
    simulated: options.SimulatedOption = False,
    seed: options.SeedOption = 1,
    as_json: options.JsonOption = False,
) -> None:
    """Calibrate a load cell against known weights.

    The command prompts for each weight, from the smallest to the largest and back. Each reading is
    the mean over one second in which the weight is at rest; outliers are ignored. The command fits
    a line and prints `scale` and `offset_n` with their standard uncertainties, the error of the
    line at every weight, and the hysteresis.

    End the sensor's node first, because only one program can open a port. Six-axis sensors are
    calibrated by their manufacturer and are refused. `g` is between 9.780 (equator) and 9.832
    m/s^2 (poles), so its default is wrong by up to 0.3 %.
    """
    from tactile_bringup.launch_config.parameter_files import ParameterFile
    from tactile_lab.devices.load_cell import fit_load_cell, set_parameters
    from tactile_sim.pty_server import WeightStand

    output = Output(as_json)
    weights_kg = parse_weights(weights)
    stated = ParameterFile(params).of(NODE) if params and params.exists() else {}
    stand: Optional[WeightStand] = None

    def hang(mass_kg: float) -> None:
        if stand is not None:
            stand.hang(mass_kg * gravity_m_s2)
            return
        what = f'hang {mass_kg:g} kg' if mass_kg else 'remove all weights'
        output.say(f'{what}, wait until it is at rest, then press Enter')
        if not sys.stdin.readline():
            raise TactileError('standard input has ended; run the command in a terminal')

    with ExitStack() as stack:
        if simulated:
            if sensor:
                raise TactileError('--simulated has its own sensor; omit --sensor')
            stand = stack.enter_context(WeightStand(seed=seed))
            output.say('SIMULATED load cell: no number is a measurement.')
            stated = {'port': stand.port}
        elif sensor:
            stated = {**stated, 'port': sensor}
        readings = measure(_config(stated), weights_kg, hang, output, goes_down=down)
    fit = fit_load_cell(readings, gravity_m_s2)
    output.say(_as_table(fit, gravity_m_s2, simulated))
    hysteresis = 'not measured' if fit.hysteresis_n is None else f'{fit.hysteresis_n:.2g} N'
    output.say(
        f'scale {fit.scale:.6g} ± {fit.scale_error:.2g}, offset_n {fit.offset_n:.4g} ± '
        f'{fit.offset_error_n:.2g} N (standard uncertainties); largest error of the line '
        f'{fit.largest_residual_n:.2g} N; hysteresis {hysteresis}'
    )
    if params is not None:
        set_parameters(params, NODE, {'scale': fit.scale, 'offset_n': fit.offset_n})
        output.say(f'{params}: scale and offset_n of {NODE} were changed')
    asked = {'simulated': simulated, 'gravity_m_s2': gravity_m_s2, 'params': str(params or '')}
    output.result({**asked, **asdict(fit)})


def parse_weights(text: str) -> tuple[float, ...]:
    """Return the masses in a text such as ``0,0.2,0.5`` [kg], in increasing order."""
    from tactile_lab.devices.load_cell import CalibrationError, FEWEST_WEIGHTS

    try:
        weights = tuple(sorted(set(map(float, options.split(text)))))
    except ValueError:
        raise CalibrationError(
            f'--weights is "{text}"; write kilograms separated by commas, such as 0,0.2,0.5,1'
        ) from None
    if not all(math.isfinite(mass) and 0.0 <= mass <= 1000.0 for mass in weights):
        raise CalibrationError(f'--weights is "{text}"; each must be from 0 to 1000 kg')
    if len(weights) < FEWEST_WEIGHTS:
        raise CalibrationError(
            f'--weights has {len(weights)} different values; give at least {FEWEST_WEIGHTS}'
        )
    return weights


def measure(
    config: 'TendonSensorConfig',
    weights_kg: Sequence[float],
    hang: Callable[[float], None],
    output: Output,
    *,
    goes_down: bool,
) -> list['WeightReading']:
    """Measure the reading for each weight, when it is at rest.

    If ``goes_down`` is True, the weights are then decreased again and measured a second time.
    """
    from tactile_lab.devices.load_cell import WeightReading
    from tendon_sensor_driver.errors import TendonSensorError
    from tendon_sensor_driver.sensors import make_sensor

    masses = [*weights_kg, *(reversed(weights_kg[:-1]) if goes_down else ())]
    rising = [True, *(b > a for a, b in pairwise(masses))]
    listener = _Listener(config)
    readings = []
    client = make_sensor(config, listener.take, time.time_ns)
    try:
        client.open()
        for mass_kg, is_rising in zip(masses, rising, strict=True):
            hang(mass_kg)
            mean_n, noise_n = listener.wait_settled(mass_kg)
            output.say(f'{mass_kg:g} kg: reading {mean_n:.4f} N, noise {noise_n:.2g} N')
            readings.append(WeightReading(mass_kg, mean_n, noise_n, is_rising))
    except TendonSensorError as error:
        raise TactileError(str(error)) from error
    finally:
        client.close()
    return readings


class _Listener:
    """Receives the sensor's samples, and keeps those of the last second."""

    def __init__(self, config: 'TendonSensorConfig') -> None:
        self._arrived = threading.Condition()
        self._config = config
        self._count = max(4, round(SETTLED_S * config.rate_hz))
        self._samples: deque[float] = deque(maxlen=self._count)
        self._since_ns = 0

    def take(self, block: 'StrainBlock') -> None:
        from tactile_ros.strain import NO_MEASUREMENT

        with self._arrived:
            if block.status & NO_MEASUREMENT:
                self._samples.clear()
            elif block.stamp_ns >= self._since_ns:
                self._samples.extend(float(value) for value in block.tension_n)
            self._arrived.notify_all()

    def wait_settled(self, mass_kg: float) -> tuple[float, float]:
        """Wait until the weight is at rest; return mean and standard deviation of a second [N]."""
        deadline_s = time.monotonic() + SETTLE_TIMEOUT_S
        with self._arrived:
            self._since_ns = time.time_ns()  # a busy computer may deliver older samples late
            for _ in range(2):  # the first second at rest may contain the end of a swing
                self._samples.clear()
                left_s = deadline_s - time.monotonic()
                found = self._arrived.wait_for(self._find_settled, left_s)
                if found is None:
                    break
            if found is not None:
                return found
            heard = len(self._samples)
        if heard < self._count:
            raise TactileError(
                f'no full second of valid samples arrived; "tactile check --sensor '
                f'{self._config.port}" says why'
            )
        raise TactileError(
            f'the weight of {mass_kg:g} kg did not come to rest; let it hang still and try again'
        )

    def _find_settled(self) -> Optional[tuple[float, float]]:
        import numpy as np

        from tactile_lab.devices.load_cell import settled_mean

        is_full = len(self._samples) == self._count
        return settled_mean(np.array(self._samples)) if is_full else None


def _config(stated: dict[str, object]) -> 'TendonSensorConfig':
    from tactile_lab.devices.checks import make_config

    config: TendonSensorConfig = make_config(NODE, {**stated, 'scale': 1.0, 'offset_n': 0.0})
    if config.sensor != 'line':
        raise TactileError(
            f'a {config.sensor} is calibrated by its manufacturer; this command is for load cells'
        )
    return config


def _as_table(fit: 'LoadCellFit', gravity_m_s2: float, simulated: bool) -> Table:
    header = ('weight [kg]', 'load', 'force [N]', 'reading [N]', 'error of the line [N]')
    title = 'load cell, SIMULATED' if simulated else 'load cell'
    table = Table(*header, title=title, right_from=0)
    for reading, residual_n in zip(fit.readings, fit.residuals_n, strict=True):
        table.add_row(
            f'{reading.mass_kg:g}',
            'increasing' if reading.is_rising else 'decreasing',
            f'{reading.mass_kg * gravity_m_s2:.4f}',
            f'{reading.reading_n:.4f}',
            f'{residual_n:+.4f}',
        )
    return table
