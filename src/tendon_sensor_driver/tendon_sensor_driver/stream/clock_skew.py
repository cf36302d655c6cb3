# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Clock-skew filter: offset and drift between the device's clock and the host's.

A sample arrives some delay after it was taken. Most delays are short, some are long (a busy
host, a USB adapter that collects for 16 ms), none is negative. The smallest differences
"arrival minus device time" are right, the others are late. The line close below all of them
is the drift between the two clocks (Moon, Skelly and Towsley, "Estimation and removal of
clock skew from network delay measurements", 1999).
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
import math

SECOND_NS = 1_000_000_000
STEP_NS = SECOND_NS
"""A larger rise of the difference is treated as a clock step, not as a delay [ns]."""

_HORIZON = 30  # least differences that are kept
_LEAST_SAMPLES = 30  # for one least difference, so that it is likely to be a short delay
_MOST_SECONDS = 3  # however few samples come
_FORGET_S = 8.0  # weight of the past, against a drift that changes
_FEWEST = 5  # least differences that tell a slope
_RECENT = 10  # least differences that tell the scatter
_LARGEST_SLOPE = 0.01  # a ceramic resonator is off by 0.5 %
_RISE_NS = 50_000_000  # of all of the last few: the host's clock was set
_CHANGE_NS = 500_000  # a drift that changes by 10 ppm, bursts that beat with the samples


class ClockSkewFilter:
    """A lower bound of the differences, linear in time, refitted once a second.

    Differences are kept as the least one of each second, or of thirty samples or three
    seconds of a slow device. The line goes along the lower convex hull of the last thirty of
    them, by the edge under their mean time, which is weighted towards the present. Where the
    last five lie more than 50 ms above the line, a clock was set and what is older is
    forgotten.

    Attributes
    ----------
    slope : float
        Drift: host time per device time, less one [1]; within 0.01.
    scatter_ns : int
        How far the line may be off [ns]: three times the median (the largest, of fewer than
        ten) of how far the least differences of the last seconds lie above it, and 0.5 ms for
        what bursts and a changing drift hide. Negative: not known, for the slope is not yet.
    """

    def __init__(self) -> None:
        self.slope = 0.0
        self.scatter_ns = -1
        self._points: deque[tuple[int, int]] = deque(maxlen=_HORIZON)
        self._device_ns = 0  # a point of the line
        self._difference_ns = 0
        self._second = 0  # of the least difference under construction
        self._samples = 0
        self._least = (0, 0)

    def restart(self, device_ns: int, difference_ns: int) -> None:
        """Begin again with one point. The slope stays, because the crystals are the same."""
        self._points.clear()
        self.scatter_ns = -1
        self._device_ns, self._difference_ns = device_ns, difference_ns
        self._begin_least(device_ns, difference_ns)

    def shift(self, step_ns: int) -> None:
        """Move line and differences up by a step of the host's clock [ns]."""
        self._difference_ns += step_ns
        self._least = (self._least[0], self._least[1] + step_ns)
        points = [
            (device_ns, difference_ns + step_ns) for device_ns, difference_ns in self._points
        ]
        self._points.clear()
        self._points.extend(points)

    def at(self, device_ns: int) -> int:
        """Return the line's difference at a device time [ns]."""
        return self._difference_ns + round(self.slope * (device_ns - self._device_ns))

    def add(self, device_ns: int, difference_ns: int) -> None:
        """Take the difference of a sample that is newer than those before [ns]."""
        seconds = device_ns // SECOND_NS - self._second
        if seconds >= (1 if self._samples >= _LEAST_SAMPLES else _MOST_SECONDS):
            self._points.append(self._least)
            self._fit()
            self._begin_least(device_ns, difference_ns)
        else:
            self._samples += 1
            least_device_ns, least_ns = self._least
            drift_ns = self.slope * (device_ns - least_device_ns)
            if difference_ns - least_ns < drift_ns:
                self._least = (device_ns, difference_ns)
        self._difference_ns += min(0, difference_ns - self.at(device_ns))

    def _begin_least(self, device_ns: int, difference_ns: int) -> None:
        self._second = device_ns // SECOND_NS
        self._samples = 1
        self._least = (device_ns, difference_ns)

    def _fit(self) -> None:
        points = list(self._points)
        newest = points[-_FEWEST:]
        if len(newest) == _FEWEST and all(y - self.at(x) > _RISE_NS for x, y in newest):
            points = newest
            self._points.clear()
            self._points.extend(newest)
        # Relative to the newest point, in which floats are exact enough.
        origin_ns, base_ns = points[-1]
        relative = [((x - origin_ns) / 1e9, float(y - base_ns)) for x, y in points]
        if len(points) >= _FEWEST:
            slope = _compute_slope(relative) / 1e9
            self.slope = max(-_LARGEST_SLOPE, min(_LARGEST_SLOPE, slope))
        heights_ns = [y - self.slope * 1e9 * x for x, y in relative]
        lowest_ns = min(heights_ns)
        self._device_ns, self._difference_ns = origin_ns, base_ns + round(lowest_ns)
        if len(points) >= _FEWEST:
            above_ns = sorted(height - lowest_ns for height in heights_ns[-_RECENT:])
            typical = len(above_ns) // 2 if len(points) >= _RECENT else -1
            self.scatter_ns = round(3 * above_ns[typical]) + _CHANGE_NS


def _compute_slope(points: list[tuple[float, float]]) -> float:
    """Return the slope of the lower hull's edge under the weighted mean of the abscissae."""
    weights = [math.exp(x / _FORGET_S) for x, _ in points]
    mean = sum(w * x for w, (x, _) in zip(weights, points, strict=True)) / sum(weights)
    hull: list[tuple[float, float]] = []
    for x, y in points:
        while len(hull) > 1:
            (x0, y0), (x1, y1) = hull[-2:]
            if (y1 - y0) * (x - x1) < (y - y1) * (x1 - x0):
                break
            hull.pop()
        hull.append((x, y))
    slope = 0.0
    for (x0, y0), (x1, y1) in pairwise(hull):
        slope = (y1 - y0) / (x1 - x0)
        if x1 >= mean:
            break
    return slope
