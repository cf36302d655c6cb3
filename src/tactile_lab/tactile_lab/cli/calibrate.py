# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arguments and help of `tactile calibrate`; the work is in `tactile_lab.commands`.

Ubuntu 24.04 has Typer 0.9, which refuses ``X | None`` and does not look into annotations
that are strings: so ``Optional[X]``, and no ``from __future__ import annotations`` here.
"""

from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.options import (
    JsonOption,
    refusals,
    SeedOption,
    SensorOption,
    SimulatedOption,
)


def calibrate(
    weights: Annotated[
        str, typer.Option(help='Known masses [kg], with commas, at least three: 0,0.2,0.5,1.')
    ],
    sensor: SensorOption = '',
    params: Annotated[
        Optional[Path],
        typer.Option(
            help='YAML file with ROS parameters. `scale` and `offset_n` of `tendon_sensor` are '
            'set in it, the rest stays. Default: print only.'
        ),
    ] = None,
    gravity: Annotated[
        float,
        typer.Option('--g', min=9.7, max=9.9, help='Acceleration of free fall where you are.'),
    ] = 9.80665,
    down: Annotated[
        bool, typer.Option(help='Also measure the weights on the way down: shows hysteresis.')
    ] = True,
    simulated: SimulatedOption = False,
    seed: SeedOption = 1,
    json_output: JsonOption = False,
) -> None:
    """Calibrate a load cell against known weights.

    The command prints which weight to hang, from the smallest to the largest and back. Each
    reading is the mean of a settled second, without outliers. Fits a line and prints `scale` and
    `offset_n` with their standard uncertainties, the error of the line at every weight, and the
    hysteresis.

    End the sensor's node first: only one program can open a port. Six-axis sensors have the
    calibration of their maker and are refused. `g` lies between 9.780 (equator) and 9.832 m/s^2
    (poles), so its default is wrong by up to 0.3 %.
    """
    with refusals():
        from tactile_lab.commands.calibrate import (
            CalibrateRequest,
            parse_weights,
            run_calibrate,
        )

        run_calibrate(
            CalibrateRequest(
                weights_kg=parse_weights(weights),
                sensor=sensor,
                params=params,
                gravity_m_s2=gravity,
                goes_down=down,
                simulated=simulated,
                seed=seed,
            ),
            as_json=json_output,
        )
