# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Readings of the load cell from the force on it, for many trials or sample by sample.

The effects have the same order as in the hardware: crosstalk of the contact through the mount,
low-pass filter, zero (bias and drift), noise, saturation, steps of the converter.
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


@lru_cache(maxsize=512)  # lengths of steps differ only by rounding
def low_pass_coefficients(step_s: float, low_pass_hz: float) -> tuple[float, float, float]:
    """Return the coefficients of one step of the one-pole filter; see `compute_relaxation`."""
    return compute_relaxation(step_s, 1 / (2 * math.pi * low_pass_hz))


def read_tension(
    cell: LoadCell,
    tension_n: FloatArray,
    sensor_bias_n: FloatArray,
    generators: Sequence[np.random.Generator],
) -> FloatArray:
    """Return the readings of the load cell from the filtered force on it.

    The drift of each trial starts at 0. The first readings of a trial do not depend on the number
    of later readings.

    Parameters
    ----------
    tension_n : ndarray of float, shape (trials, samples)
        Force after crosstalk and low pass [N]; NaN is kept.
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
    """Return the standard deviation of the random walk from one sample to the next [N]."""
    return cell.drift_n_rt_s * math.sqrt(cell.period_s)


def convert_one(cell: LoadCell, signal_n: float, noise: float) -> float:
    """Return the reading [N] for one force, which may be infinite.

    The result equals the result of `convert_to_reading`, bit for bit.
    """
    most = _count_steps(cell)
    counts = (signal_n + cell.noise_n * noise) / cell.resolution_n
    whole = round(min(max(counts, -most), most))
    return cell.resolution_n * math.copysign(whole, counts)  # keeps the sign of zero


def _count_steps(cell: LoadCell) -> int:
    # The last step of the converter is the last one within the capacity.
    return math.floor(cell.capacity_n / cell.resolution_n * (1 + 1e-12))


def convert_to_reading(cell: LoadCell, signal_n: FloatArray, noise: FloatArray) -> FloatArray:
    """Add standard normal noise, limit to the capacity, round to the converter's steps [N]."""
    most = _count_steps(cell)
    counts = np.rint((signal_n + cell.noise_n * noise) / cell.resolution_n)
    return np.asarray(cell.resolution_n * np.clip(counts, -most, most))
