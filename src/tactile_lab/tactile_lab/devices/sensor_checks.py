# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Listens to the force sensor and says what it found, with a remedy for each fault."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import time
from typing import Any

import numpy as np

from tactile_lab.devices.device_checks import CheckReport, Problem
from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.client_base import NowNs, OnBlock, SensorClient
from tendon_sensor_driver.errors import TendonSensorError
from tendon_sensor_driver.records import Health, TendonSensorConfig
from tendon_sensor_driver.sensors import make_sensor

MakeSensor = Callable[[TendonSensorConfig, OnBlock, NowNs], SensorClient]
"""Makes the client of a sensor, as `make_sensor` does."""

RATE_TOLERANCE = 0.02
MOST_STAMP_ERROR_S = 0.005

_STATUS_REMEDIES = {
    StrainStatus.SATURATED: (
        'the sensor saturates',
        'unload the tendon; if it stays, check the wiring of the bridge',
    ),
    StrainStatus.STUCK: (
        'the reading does not change at all',
        'check the cable between load cell and amplifier; a coarse sensor needs stuck_s = 0',
    ),
}


def check_sensor(
    config: TendonSensorConfig, seconds: float, make: MakeSensor = make_sensor
) -> CheckReport:
    """Listen to the sensor.

    Parameters
    ----------
    config : TendonSensorConfig
    seconds : float
        How long [s]; leave the tendon alone meanwhile, or the noise is not noise.
    make : callable
        Makes the client; for a sensor on a topic one that has a node.
    """
    link = {'net_ft': config.host, 'topic': config.topic}.get(config.sensor, config.port)
    blocks: list[StrainBlock] = []
    client = make(config, blocks.append, time.time_ns)
    try:
        client.open()
        time.sleep(seconds)
        health, identity = client.health(), client.identity
    except TendonSensorError as error:
        return CheckReport('sensor', link, {}, (Problem(str(error)),))
    finally:
        client.close()
    if not config.rate_hz and health.rate_hz:
        config = replace(config, rate_hz=health.rate_hz)
    facts, problems = judge_blocks(blocks, config)
    if config.sensor == 'topic':
        problems = _judge_topic(health, problems, seconds, is_heard=bool(blocks))
        return CheckReport('sensor', link, facts, tuple(problems))
    if identity:
        facts = {'identity': identity, **facts}
    if health.rate_hz:
        facts['rate that the device states [Hz]'] = round(health.rate_hz, 3)
    if health.device_status:
        problems.append(Problem(f'the sensor says: {health.device_status}', 'power-cycle it'))
    if out_of_order := health.duplicates + health.late_samples + health.outliers:
        problems.append(
            Problem(
                f'{out_of_order} readings came twice, too late or at an impossible time',
                'check time_column and time_unit_s, and the cable',
            )
        )
    if not blocks:
        said = health.last_error or (
            f'the last line was "{health.last_rejected}": {health.last_reason}'
            if health.last_rejected
            else 'silence'
        )
        remedy = 'check baud, unit and columns; "tactile devices" says what fits'
        problems = [Problem(f'no reading in {seconds:g} s: {said}', remedy)]
    elif health.rejected_lines:
        problems.append(
            Problem(
                f'{health.rejected_lines} lines were no readings, the last one '
                f'"{health.last_rejected}": {health.last_reason}',
                'check ground and shield of the cable, and the columns',
            )
        )
    return CheckReport('sensor', link, facts, tuple(problems))


def _judge_topic(
    health: Health, problems: list[Problem], seconds: float, *, is_heard: bool
) -> list[Problem]:
    if not is_heard:
        said = (
            health.last_error
            or health.last_rejected
            or health.advice
            or 'too few messages to measure the rate; set rate_hz, or listen longer'
        )
        return [Problem(f'no reading in {seconds:g} s: {said}')]
    rejected = [Problem(health.last_rejected)] if health.rejected_lines else []
    # The rate is judged by the blocks already.
    advice = [Problem(health.advice)] if health.advice and 'rate_hz' not in health.advice else []
    return [*problems, *rejected, *advice]


def judge_blocks(
    blocks: list[StrainBlock], config: TendonSensorConfig
) -> tuple[dict[str, Any], list[Problem]]:
    """Return facts and problems of the blocks of a sensor whose tendon is left alone."""
    if not blocks:
        return {'samples': 0}, []
    tension_n = np.concatenate([block.tension_n for block in blocks])
    time_s = np.concatenate(
        [
            (
                block.stamp_ns
                - blocks[0].stamp_ns
                + block.period_ns * np.arange(block.tension_n.size)
            )
            * 1e-9
            for block in blocks
        ]
    )
    # The first block may count what was lost before anybody listened.
    lost = sum(block.lost_before for block in blocks[1:])
    status = StrainStatus.OK
    for block in blocks:
        status |= block.status
    span_s = float(time_s[-1] - time_s[0])
    rate_hz = (tension_n.size + lost - 1) / span_s if span_s > 0 else 0.0
    noise_n = _compute_noise_n(time_s, tension_n)
    error_s = blocks[-1].stamp_error_s
    clock = 'none: host time' if status & StrainStatus.HOST_TIME else 'not known yet'
    facts = {
        'samples': int(tension_n.size),
        'rate [Hz]': round(rate_hz, 3),
        'lost samples': int(lost),
        'tension [N]': round(float(tension_n.mean()), 4),
        'noise, standard deviation [N]': round(noise_n, 5),
        'error of the stamps [s]': round(error_s, 6) if error_s >= 0 else clock,
    }
    if status & StrainStatus.SIMULATED:
        facts['simulated'] = 'SIMULATED: no number is a measurement'
    problems = [Problem(*text) for bit, text in _STATUS_REMEDIES.items() if status & bit]
    if abs(rate_hz - config.rate_hz) > RATE_TOLERANCE * config.rate_hz:
        problems.append(
            Problem(
                f'the rate is {rate_hz:.2f} Hz and rate_hz is {config.rate_hz:g}',
                f'set rate_hz to {rate_hz:.4g}, or the sensor to {config.rate_hz:g}',
            )
        )
    if lost:
        problems.append(
            Problem(
                f'{lost} of {tension_n.size + lost} samples were lost',
                'check the cable, a higher baud, and what else this computer does',
            )
        )
    if error_s > MOST_STAMP_ERROR_S:
        problems.append(
            Problem(
                f'the stamps may be wrong by {error_s * 1e3:.1f} ms',
                "install the udev rule for the adapter's latency timer; free the computer",
            )
        )
    return facts, problems


def _compute_noise_n(time_s: Any, tension_n: Any) -> float:
    """Standard deviation about a straight line, so that a slow drift is no noise [N]."""
    if tension_n.size < 3:
        return 0.0
    line = np.polynomial.Polynomial.fit(time_s, tension_n, 1)
    return float(np.std(tension_n - line(time_s), ddof=2))
