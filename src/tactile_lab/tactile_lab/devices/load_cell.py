# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration of a load cell with known weights, and editing of a parameter file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
import yaml

from tactile_ros.errors import named_errors, TactileError
from tactile_ros.files import replace_file
from tactile_ros.yaml_files import load_yaml, read_text

MAX_BYTES = 2**20
"""Largest file that is edited [byte]."""

_PARAMETERS = 'ros__parameters'


def set_parameters(path: Path, node: str, values: Mapping[str, float]) -> None:
    """Set parameters of a node in a parameter file; create the file if it does not exist.

    The file is replaced atomically.

    Raises `TactileError` when the file cannot be read, edited or written.
    """
    with named_errors('write', path):
        try:
            text = read_text(path, MAX_BYTES) if path.exists() else ''
            replace_file(path, edit_parameters(text, node, values).encode())
        except TactileError as error:
            raise TactileError(f'cannot set parameters in {path}: {error}') from error


def edit_parameters(text: str, node: str, values: Mapping[str, float]) -> str:
    """Return the text of a parameter file in which the ``values`` of a node are set.

    Comments and all other values are kept. Raises `TactileError` when the text is not a parameter
    file, or when the edit would change other values.
    """
    before = load_yaml(text)
    if before is not None and not isinstance(before, dict):
        raise TactileError('it is not a ROS parameter file, which has node names at the top level')
    new = text
    for name, value in values.items():
        new = _edit(new, node, name, repr(float(value)))
    wanted = _expected(before or {}, node, values)
    try:
        is_right = load_yaml(new) == wanted
    except TactileError:
        is_right = False
    if not is_right:
        lines = ', '.join(f'{name}: {float(value)!r}' for name, value in values.items())
        raise TactileError(
            f'the file cannot be edited automatically; set these parameters of {node} by hand: '
            f'{lines}'
        )
    return new


def _expected(before: dict[str, object], node: str, values: Mapping[str, float]) -> object:
    keys = [k for k in before if str(k).strip('/') == node]
    if len(keys) > 1:
        raise TactileError(f'it has blocks for {" and ".join(map(str, keys))}; keep one of them')
    key = keys[0] if keys else node
    content = before.get(key) or {}
    parameters = content.get(_PARAMETERS) or {} if isinstance(content, dict) else {}
    if not isinstance(content, dict) or not isinstance(parameters, dict):
        raise TactileError(f'{key} has no {_PARAMETERS} below it')
    numbers = {name: float(value) for name, value in values.items()}
    return {**before, key: {**content, _PARAMETERS: {**parameters, **numbers}}}


def _edit(text: str, node: str, name: str, value: str) -> str:
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    of_node = _find(root, node)
    parameters = _find(of_node, _PARAMETERS)
    if not isinstance(parameters, yaml.MappingNode) or not parameters.value:
        end = '' if not text or text.endswith('\n') else '\n'
        return f'{text}{end}{node}:\n  {_PARAMETERS}:\n    {name}: {value}\n'
    old = _find(parameters, name)
    if old is not None:
        return text[: old.start_mark.index] + value + text[old.end_mark.index :]
    mark = parameters.value[0][0].start_mark
    if parameters.flow_style:
        return f'{text[: mark.index]}{name}: {value}, {text[mark.index :]}'
    return f'{text[: mark.index]}{name}: {value}\n{" " * mark.column}{text[mark.index :]}'


def _find(parent: yaml.Node | None, name: str) -> yaml.Node | None:
    if not isinstance(parent, yaml.MappingNode):
        return None
    return next((v for k, v in parent.value if str(k.value).strip('/') == name), None)


FEWEST_WEIGHTS = 3
"""Smallest number of different weights. With two weights, the line would fit exactly, so that its
uncertainty could not be estimated."""

LARGEST_SPREAD_N = 0.1
"""If the standard deviation within a second is larger [N], the weight is still swinging."""

SMALLEST_CHANGE_N = 0.005
"""A reading is at rest if it changes by less than this within a second [N]."""

_REJECTED = 5.0 * 1.4826
"""A sample is an outlier if its distance from the median is larger than this factor times the
median absolute deviation. For a normal distribution, this is five standard deviations."""


class CalibrationError(TactileError):
    """The readings do not allow a calibration; the message has the reason."""


@dataclass(frozen=True)
class WeightReading:
    """Reading of the sensor for one weight, measured with scale 1 and offset 0.

    ``reading_n`` and ``noise_n`` are mean and standard deviation over one second at rest [N].
    ``is_rising`` is true if the previous weight was smaller.
    """

    mass_kg: float
    reading_n: float
    noise_n: float
    is_rising: bool


@dataclass(frozen=True)
class LoadCellFit:
    """The fitted line ``force = scale * reading + offset_n``.

    Attributes
    ----------
    scale, offset_n : float
        Parameters of the sensor node.
    scale_error, offset_error_n : float
        Standard uncertainties of scale and offset, from the residuals.
    residuals_n : tuple of float
        Calibrated force minus true force of each reading [N].
    largest_residual_n : float
        Largest absolute residual [N].
    hysteresis_n : float or None
        Largest difference at one weight between increasing and decreasing loads [N]; None if no
        weight was measured in both directions.
    """

    scale: float
    offset_n: float
    scale_error: float
    offset_error_n: float
    residuals_n: tuple[float, ...]
    largest_residual_n: float
    hysteresis_n: float | None
    readings: tuple[WeightReading, ...]


def settled_mean(tension_n: ArrayLike) -> tuple[float, float] | None:
    """Return mean and standard deviation of a second of samples; None if the weight swings.

    Outliers are ignored. The weight is at rest if the means of the first and the second half
    differ by at most four standard errors of their difference, or by at most
    `SMALLEST_CHANGE_N`.
    """
    values = np.asarray(tension_n, dtype=np.float64)
    if values.size < 4 or not np.isfinite(values).all():
        return None
    median = np.median(values)
    spread = np.median(np.abs(values - median))
    # If half of the samples are equal (coarse converter), the spread is 0 and nothing is ignored.
    is_near = np.abs(values - median) <= (_REJECTED * spread if spread > 0.0 else np.inf)
    half = values.size // 2
    first, second = values[:half][is_near[:half]], values[half:][is_near[half:]]
    kept = values[is_near]
    deviation = float(kept.std(ddof=1))
    if deviation > LARGEST_SPREAD_N or not first.size or not second.size:
        return None
    error = deviation * math.sqrt(1.0 / first.size + 1.0 / second.size)
    if abs(float(second.mean() - first.mean())) > max(4.0 * error, SMALLEST_CHANGE_N):
        return None
    return float(kept.mean()), deviation


def fit_load_cell(readings: Sequence[WeightReading], gravity_m_s2: float) -> LoadCellFit:
    """Fit the calibration line by least squares.

    The weights are known and the readings are noisy. Therefore the readings are fitted as a
    function of the true forces, and the fitted line is then inverted. Uncertainties are computed
    by linear error propagation.

    Raises `CalibrationError` when there are too few weights, or when the readings do not increase
    (or decrease) with the weights.
    """
    force_n = np.array([reading.mass_kg for reading in readings]) * gravity_m_s2
    value_n = np.array([reading.reading_n for reading in readings])
    _check_order(readings)
    slope, intercept = _fit_line(force_n, value_n)
    scale, offset_n = 1.0 / slope, -intercept / slope
    residuals = (value_n - (slope * force_n + intercept)) / slope
    count = len(readings)
    middle = float(force_n.mean())
    width = float(((force_n - middle) ** 2).sum())
    sigma_n = math.sqrt(float((residuals**2).sum()) / (count - 2))  # of a reading, in newtons
    return LoadCellFit(
        scale=scale,
        offset_n=offset_n,
        scale_error=abs(scale) * sigma_n / math.sqrt(width),
        offset_error_n=sigma_n * math.sqrt(1.0 / count + middle**2 / width),
        residuals_n=tuple(residuals.tolist()),
        largest_residual_n=float(np.abs(residuals).max()),
        hysteresis_n=_find_hysteresis(readings, abs(scale)),
        readings=tuple(readings),
    )


def _fit_line(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    x_mean, y_mean = float(x.mean()), float(y.mean())
    from_mean = x - x_mean
    slope = float(from_mean @ (y - y_mean)) / float(from_mean @ from_mean)
    return slope, y_mean - slope * x_mean


def _check_order(readings: Sequence[WeightReading]) -> None:
    masses = sorted({reading.mass_kg for reading in readings})
    if len(masses) < FEWEST_WEIGHTS:
        raise CalibrationError(
            f'there are {len(masses)} different weights; use at least {FEWEST_WEIGHTS}, one of '
            'them zero'
        )
    means = [
        math.fsum(values) / len(values)
        for mass in masses
        if (values := [r.reading_n for r in readings if r.mass_kg == mass])
    ]
    steps = np.diff(means)
    if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        wrong = int(np.argmin(steps * np.sign(means[-1] - means[0])))
        raise CalibrationError(
            f'from {masses[wrong]:g} to {masses[wrong + 1]:g} kg, the reading changes in the '
            f'wrong direction or not at all ({means[wrong]:.4g} to {means[wrong + 1]:.4g} N); '
            'check the order of the weights, that they hang freely, and the capacity of the cell'
        )


def _find_hysteresis(readings: Sequence[WeightReading], scale: float) -> float | None:
    found = []
    for mass in {reading.mass_kg for reading in readings}:
        ways = [
            [r.reading_n for r in readings if r.mass_kg == mass and r.is_rising is rising]
            for rising in (True, False)
        ]
        if all(ways):
            up, down = (math.fsum(way) / len(way) for way in ways)
            found.append(scale * abs(up - down))
    return max(found, default=None)
