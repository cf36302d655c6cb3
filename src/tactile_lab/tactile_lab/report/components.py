# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Features that are amplitudes of Fourier components, with their frequencies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_features.spec import FeatureSpec

_KINDS = (
    ('__spectrum__hz_', 1.0, 'frequency [Hz]'),
    ('__spatial_spectrum__per_m_', 1e-3, 'spatial frequency [cycles/mm]'),
)


@dataclass(frozen=True)
class Components:
    """The Fourier components above zero among the features of a set.

    Attributes
    ----------
    columns : ndarray of int, shape (k,)
        Their columns in the table.
    frequency : ndarray of shape (k,)
        In the unit of ``title``.
    title : str
        For an axis.
    """

    columns: NDArray[np.intp]
    frequency: NDArray[np.float64]
    title: str


def find_components(spec: FeatureSpec) -> Components | None:
    """Return the components by the features' names, or None where there are fewer than two.

    The one at zero is left out: the mean has been taken off.
    """
    for mark, factor, title in _KINDS:
        found = {
            i: factor * float(name.rpartition(mark)[2])
            for i, name in enumerate(spec.names)
            if mark in name
        }
        above = {i: value for i, value in found.items() if value > 0}
        if len(above) > 1:
            return Components(
                np.array(list(above), dtype=np.intp), np.array(list(above.values())), title
            )
    return None
