# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Units, axes and frames of ATI's six-axis sensors: counts to newtons and newton metres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tendon_sensor_driver.errors import LinkError
from tendon_sensor_driver.records import NEWTONS

_POUND_N, _KILOGRAM_N = NEWTONS['lbf'], NEWTONS['kg']
_INCH_M = 0.0254

_UNITS = {
    'force': {
        'lbf': _POUND_N,
        'N': 1.0,
        'klbf': 1e3 * _POUND_N,
        'kN': 1e3,
        'kgf': _KILOGRAM_N,
        'gf': 1e-3 * _KILOGRAM_N,
    },
    'torque': {
        'lbf-in': _POUND_N * _INCH_M,
        'lbf-ft': _POUND_N * 12 * _INCH_M,
        'N-m': 1.0,
        'N-mm': 1e-3,
        'kgf-cm': 1e-2 * _KILOGRAM_N,
        'kN-m': 1e3,
    },
}
"""Newtons or newton metres in one unit, in the order of ATI's codes, which begin with 1."""


def unit_of_code(kind: str, code: int) -> str:
    """Return the name of a unit of ``force`` or ``torque`` by ATI's code.

    Raises
    ------
    LinkError
        When there is no such code.
    """
    names = tuple(_UNITS[kind])
    if not 1 <= code <= len(names):
        raise LinkError(f'the sensor names {kind} unit {code}; known are 1 to {len(names)}')
    return names[code - 1]


def compute_si_per_count(
    force_unit: str, torque_unit: str, counts_per_force: float, counts_per_torque: float
) -> NDArray[np.float64]:
    """Return what one count of each component is worth.

    Parameters
    ----------
    force_unit, torque_unit : str
        As the sensor spells them; ``Nm`` and ``N-m`` are the same.
    counts_per_force, counts_per_torque : float
        Counts per unit.

    Returns
    -------
    ndarray
        float64, shape (6,) [N, N, N, N m, N m, N m].

    Raises
    ------
    LinkError
        When a unit is not known, or a number of counts is not positive.
    """
    for name, counts in (('force', counts_per_force), ('torque', counts_per_torque)):
        if not 0 < counts < float('inf'):
            raise LinkError(
                f'the sensor states {counts} counts per {name} unit; '
                'check that its active configuration has a calibration'
            )
    force_n = _find('force', force_unit) / counts_per_force
    torque_n_m = _find('torque', torque_unit) / counts_per_torque
    return np.array([force_n] * 3 + [torque_n_m] * 3)


def _find(kind: str, name: str) -> float:
    wanted = name.replace('-', '').strip().lower()
    for unit, value in _UNITS[kind].items():
        if unit.replace('-', '').lower() == wanted:
            return value
    raise LinkError(
        f'the sensor states its {kind} in "{name}"; set it to one of {", ".join(_UNITS[kind])}'
    )
