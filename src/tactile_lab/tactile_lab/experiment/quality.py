# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Outlier check of a trial against the earlier trials of its object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

FALSE_ALARMS = 0.001
"""Share of ordinary trials that are called outliers, when the statistics are normal."""

FEWEST = 3
"""Trials of the same mounting, or other mountings, that a trial is compared with at least."""

SMALLEST_SHARE = 0.02
"""A deviation of less than this share of the usual value is no outlier."""

Statistics = Mapping[str, float]


class Range(NamedTuple):
    """Prediction interval of a statistic of a further trial: ``centre`` +/- ``half_width``."""

    centre: float
    half_width: float


def summarise_tension(tension_n: ArrayLike) -> dict[str, float]:
    """Return mean and standard deviation of the tension in a window [N]; empty: no samples."""
    values = np.asarray(tension_n, dtype=np.float64)
    if values.size == 0 or not np.isfinite(values).all():
        return {}
    return {'mean_n': float(values.mean()), 'deviation_n': float(values.std())}


def usual_range(
    name: str, mounting_id: str, earlier: Sequence[tuple[str, Statistics]], count: int
) -> Range | None:
    """Return the prediction interval of a statistic, or None when too little is known.

    A trial is compared with those of its own mounting, where there are `FEWEST`: mean plus and
    minus t s sqrt(1 + 1/n), with the deviation within all mountings. The first trials of a
    mounting are compared with the means of other mountings, where there are `FEWEST`.

    Parameters
    ----------
    name : str
        Of the statistic.
    mounting_id : str
        Of the trial.
    earlier : sequence of (str, mapping)
        Mounting and statistics of earlier trials of the same object and contact.
    count : int
        Number of statistics that are compared; they share the false alarms.
    """
    known = sorted((m, s[name]) for m, s in earlier if name in s)
    mountings = {
        m: np.array([value for _, value in group])
        for m, group in groupby(known, key=lambda each: each[0])
    }
    within = sum(float(((v - v.mean()) ** 2).sum()) for v in mountings.values())
    freedom = sum(v.size - 1 for v in mountings.values())
    own = mountings.pop(mounting_id, np.empty(0))
    if own.size >= FEWEST:
        spread = math.sqrt(within / freedom * (1.0 + 1.0 / own.size))
        return _interval(float(own.mean()), spread, freedom, count)
    if len(mountings) < FEWEST:
        return None
    means = np.array([v.mean() for v in mountings.values()])
    variance = float(means.var(ddof=1)) * (1.0 + 1.0 / means.size)
    if freedom:
        variance += within / freedom
    return _interval(float(means.mean()), math.sqrt(variance), means.size - 1, count)


def _interval(centre: float, spread: float, freedom: int, count: int) -> Range:
    from scipy.special import stdtrit  # a third of a second that `--help` need not wait

    factor = float(stdtrit(freedom, 1.0 - FALSE_ALARMS / (2 * count)))
    return Range(centre, max(factor * spread, SMALLEST_SHARE * abs(centre)))


def find_outlier(
    statistics: Statistics, mounting_id: str, earlier: Sequence[tuple[str, Statistics]]
) -> str:
    """Return a sentence when a trial is unlike the earlier ones; otherwise an empty text."""
    for name, value in statistics.items():
        usual = usual_range(name, mounting_id, earlier, len(statistics))
        if usual is not None and abs(value - usual.centre) > usual.half_width:
            return (
                f'{_TITLES.get(name, name)} {value:.3g} N, usually {usual.centre:.3g} ± '
                f'{usual.half_width:.2g} N'
            )
    return ''


_TITLES = {'mean_n': 'mean tension', 'deviation_n': 'deviation of the tension'}
