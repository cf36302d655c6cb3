# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of the load cell, which are added to the simulated tension.

Readings are computed for all samples of many trials, or for one sample. The errors have the same
order as in the hardware: crosstalk of the contact force, low-pass filter, offset (bias and drift),
noise, saturation, and rounding by the analog-to-digital converter.
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


@lru_cache(maxsize=512)  # there are only few values of ``step_s``
def low_pass_coefficients(step_s: float, low_pass_hz: float) -> tuple[float, float, float]:
    """Return the coefficients of the load cell's low-pass filter for a time step of ``step_s``.

    `compute_relaxation` describes them.
    """
    return compute_relaxation(step_s, 1 / (2 * math.pi * low_pass_hz))


def read_tension(
    cell: LoadCell,
    tension_n: FloatArray,
    sensor_bias_n: FloatArray,
    generators: Sequence[np.random.Generator],
) -> FloatArray:
    """Return the readings of the load cell for the force on it.

    The drift of each trial starts at 0. The first readings of a trial do not depend on the number
    of later readings.

    Parameters
    ----------
    tension_n : ndarray of float, shape (trials, samples)
        Force after crosstalk and low-pass filter [N]. For NaN, the reading is NaN.
    sensor_bias_n : ndarray of float, shape (trials,)
        Reading without load [N].
    generators : sequence of numpy.random.Generator
        Source of noise and drift of each trial.

    Returns
    -------
    ndarray of float, shape (trials, samples)
        Readings, which are multiples of ``cell.resolution_n`` [N].
    """
    samples = tension_n.shape[1]
    normal = np.array([generator.standard_normal((samples, 2)) for generator in generators])
    noise, steps = normal[..., 0], normal[..., 1]
    steps[:, :1] = 0.0
    drift_n = np.cumsum(compute_drift_step_n(cell) * steps, axis=1)
    return convert_to_reading(cell, tension_n + (sensor_bias_n[:, np.newaxis] + drift_n), noise)


def compute_drift_step_n(cell: LoadCell) -> float:
    """Return the standard deviation of the change of the drift between two samples [N]."""
    return cell.drift_n_rt_s * math.sqrt(cell.period_s)


def convert_one(cell: LoadCell, signal_n: float, noise: float) -> float:
    """Return the reading for one force, which may be infinite [N].

    The result is exactly equal to the result of `convert_to_reading`.
    """
    most = _count_steps(cell)
    counts = (signal_n + cell.noise_n * noise) / cell.resolution_n
    whole = round(min(max(counts, -most), most))
    return cell.resolution_n * math.copysign(whole, counts)  # -0.0 as in NumPy


def _count_steps(cell: LoadCell) -> int:
    # Number of steps of the converter within the capacity. The tolerance is for rounding errors.
    return math.floor(cell.capacity_n / cell.resolution_n * (1 + 1e-12))


def convert_to_reading(cell: LoadCell, signal_n: FloatArray, noise: FloatArray) -> FloatArray:
    """Return readings for forces: add noise, limit to the capacity, and round to a step [N].

    ``noise`` has standard normal values.
    """
    most = _count_steps(cell)
    counts = np.rint((signal_n + cell.noise_n * noise) / cell.resolution_n)
    return np.asarray(cell.resolution_n * np.clip(counts, -most, most))
