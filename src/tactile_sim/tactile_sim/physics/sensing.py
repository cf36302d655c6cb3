# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""From the force on the load cell to its readings, for many trials or sample by sample.

The order is that of the hardware: crosstalk of the contact through the mount, the sensor's
low-pass filter, its zero (bias and drift), noise, saturation, one step of the converter.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
import math

import numpy as np
from numpy.typing import NDArray

from tactile_sim.descriptions.description import LoadCell
from tactile_sim.physics.steps import compute_relaxation

FloatArray = NDArray[np.float64]


@lru_cache(maxsize=512)  # the length of a step differs by rounding alone
def low_pass_coefficients(step_s: float, low_pass_hz: float) -> tuple[float, float, float]:
    """Coefficients of one step of the sensor's one-pole filter; see `compute_relaxation`."""
    return compute_relaxation(step_s, 1 / (2 * math.pi * low_pass_hz))


def read_tension(
    cell: LoadCell,
    tension_n: FloatArray,
    sensor_bias_n: FloatArray,
    generators: Sequence[np.random.Generator],
) -> FloatArray:
    """Turn the filtered force on the load cell into its readings.

    Each trial starts with its drift at 0. The first readings of a trial do not depend on how
    many follow.

    ``tension_n`` (ndarray of float, shape (trials, samples)): force behind crosstalk and low pass
    [N]. What is not a number stays so. ``sensor_bias_n`` (ndarray of float, shape (trials,)):
    reading without load [N]. ``generators``: source of noise and drift.

    Returns the readings, of the same shape: whole multiples of ``cell.resolution_n`` [N].
    """
    samples = tension_n.shape[1]
    normal = np.array([generator.standard_normal((samples, 2)) for generator in generators])
    noise, steps = normal[..., 0], normal[..., 1]
    steps[:, :1] = 0.0
    drift_n = np.cumsum(compute_drift_step_n(cell) * steps, axis=1)
    return convert_to_reading(cell, tension_n + (sensor_bias_n[:, np.newaxis] + drift_n), noise)


def compute_drift_step_n(cell: LoadCell) -> float:
    """Standard deviation of what a random walk adds from one sample to the next [N]."""
    return cell.drift_n_rt_s * math.sqrt(cell.period_s)


def convert_one(cell: LoadCell, signal_n: float, noise: float) -> float:
    """Return `convert_to_reading` of a single number, which may be infinite; the same bits [N]."""
    most = _count_steps(cell)
    counts = (signal_n + cell.noise_n * noise) / cell.resolution_n
    whole = round(min(max(counts, -most), most))
    return cell.resolution_n * math.copysign(whole, counts)  # keeps the sign of a zero


def _count_steps(cell: LoadCell) -> int:
    # The converter's last step is the last that fits into the capacity.
    return math.floor(cell.capacity_n / cell.resolution_n * (1 + 1e-12))


def convert_to_reading(cell: LoadCell, signal_n: FloatArray, noise: FloatArray) -> FloatArray:
    """Add standard normal noise, saturate at the capacity, round to the converter's steps [N]."""
    most = _count_steps(cell)
    counts = np.rint((signal_n + cell.noise_n * noise) / cell.resolution_n)
    return np.asarray(cell.resolution_n * np.clip(counts, -most, most))
