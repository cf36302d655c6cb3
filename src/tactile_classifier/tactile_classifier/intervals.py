# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""How far an accuracy may be off: intervals from the trials or groups that it comes from."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

LEVEL = 0.95
"""Share of such intervals that are meant to hold the true value [1]."""

RESAMPLES = 2000
_SEED = 0


@dataclasses.dataclass(frozen=True)
class Interval:
    """A 95 % interval, or why there is none.

    Attributes
    ----------
    low, high : float
        Both 0 when ``reason`` is not empty.
    method : str
        What was resampled, in words.
    reason : str
        One sentence when there is no interval; empty otherwise.
    """

    low: float
    high: float
    method: str
    reason: str = ''

    def to_dict(self) -> dict[str, Any]:
        """Return the interval as what JSON can hold; no numbers where there are none."""
        if self.reason:
            return {'reason': self.reason}
        return {'low': self.low, 'high': self.high, 'level': LEVEL, 'method': self.method}


def accuracy_interval(parts: npt.NDArray[np.float64], parts_are: str) -> Interval:
    """Return the interval of a mean accuracy.

    Percentiles of the means of 2000 resamples, drawn with replacement. It covers the chance
    in which trials, or groups, were tested; not that of the training.

    Parameters
    ----------
    parts : ndarray of shape (n,)
        Accuracy of each trial (over repetitions) or of each group that was held out [1].
    parts_are : str
        ``trials`` or ``groups``.

    Notes
    -----
    Where all trials are right, or all wrong, resampling knows no spread: the interval is then
    the exact binomial one. Groups without spread get none.
    """
    count = len(parts)
    if np.ptp(parts) > 0:
        return _percentiles(parts, f'bootstrap over {count} {parts_are}')
    if parts_are == 'trials' and parts[0] in (0.0, 1.0):
        # Clopper and Pearson with no error in n: both tails, so that it fits the level.
        limit = ((1 - LEVEL) / 2) ** (1 / count)
        low, high = (limit, 1.0) if parts[0] == 1.0 else (0.0, 1.0 - limit)
        return Interval(low, high, f'exact binomial over {count} trials')
    return Interval(0.0, 0.0, '', f'all {count} {parts_are} have the same accuracy')


def difference_interval(differences: npt.NDArray[np.float64], parts_are: str) -> Interval:
    """Return the interval of a mean paired difference, as `accuracy_interval`.

    Parameters
    ----------
    differences : ndarray of shape (n,)
        One a trial, or one a group.
    parts_are : str
    """
    if np.ptp(differences) > 0:
        return _percentiles(differences, f'bootstrap over {len(differences)} {parts_are}')
    return Interval(0.0, 0.0, '', f'all {len(differences)} {parts_are} have the same difference')


def _percentiles(parts: npt.NDArray[np.float64], method: str) -> Interval:
    count = len(parts)
    generator = np.random.default_rng(_SEED)
    # How often each part is drawn: small beside the table of all draws.
    times = generator.multinomial(count, np.full(count, 1 / count), size=RESAMPLES)
    tail = 50 * (1 - LEVEL)
    low, high = np.percentile(times @ parts / count, [tail, 100 - tail])
    return Interval(float(low), float(high), method)
