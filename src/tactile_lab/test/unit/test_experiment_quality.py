# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Detection of trials with unusual tension, and the rate of its false alarms."""

import math

import numpy as np
import pytest
from scipy import stats

from tactile_lab.experiment.loop import (
    FALSE_ALARMS,
    find_outlier,
    summarise_tension,
    usual_range,
)


def test_range_is_the_prediction_interval_of_the_same_mounting():
    values = {'a': [5.0, 5.2, 5.1], 'b': [7.0, 7.4]}
    earlier = [(m, {'mean_n': v}) for m, group in values.items() for v in group]
    found = usual_range('mean_n', 'a', earlier, 2)
    pooled = math.sqrt((2 * np.var(values['a'], ddof=1) + np.var(values['b'], ddof=1)) / 3)
    factor = stats.t.ppf(1 - FALSE_ALARMS / 4, 3)
    assert found.centre == pytest.approx(5.1, rel=1e-15)
    assert found.half_width == pytest.approx(factor * pooled * math.sqrt(4 / 3), rel=1e-12)


def test_new_mounting_is_compared_with_the_means_of_other_mountings():
    earlier = [(m, {'mean_n': v}) for m, v in (('a', 5.0), ('a', 5.2), ('b', 6.0), ('c', 7.0))]
    assert usual_range('mean_n', 'd', earlier[:3], 1) is None
    found = usual_range('mean_n', 'd', earlier, 1)
    variance = np.var([5.1, 6.0, 7.0], ddof=1) * (1 + 1 / 3) + 0.02
    factor = stats.t.ppf(1 - FALSE_ALARMS / 2, 2)
    assert found.centre == pytest.approx(18.1 / 3, rel=1e-15)
    assert found.half_width == pytest.approx(factor * math.sqrt(variance), rel=1e-12)


def test_rate_of_false_alarms_is_as_stated():
    generator = np.random.default_rng(5)
    alarms = count = 0
    for _ in range(400):
        earlier = []
        for mounting in range(4):
            shift = generator.normal(0.0, 0.5)
            for _ in range(5):
                found = {
                    'mean_n': 5.0 + shift + generator.normal(0.0, 0.2),
                    'deviation_n': 0.5 + shift / 10 + generator.normal(0.0, 0.05),
                }
                alarms += bool(find_outlier(found, str(mounting), earlier))
                earlier.append((str(mounting), found))
                count += 1
    # If the stated rate is true, the number of alarms exceeds this limit once in a million.
    assert alarms <= stats.binom.ppf(1 - 1e-6, count, FALSE_ALARMS)


def test_trial_that_misses_the_plate_is_an_outlier():
    generator = np.random.default_rng(1)
    earlier = [
        (str(m), {'mean_n': 5.0 + 0.2 * generator.normal(), 'deviation_n': 0.5})
        for m in range(4)
        for _ in range(3)
    ]
    missed = {'mean_n': 1.0, 'deviation_n': 0.02}
    assert 'mean tension 1 N, usually 5' in find_outlier(missed, '3', earlier)
    assert find_outlier({'mean_n': 5.0, 'deviation_n': 0.5}, '3', earlier) is None


def test_equal_values_cause_no_alarm_for_a_rounding_difference():
    earlier = [('a', {'mean_n': 5.0})] * 9
    assert find_outlier({'mean_n': 5.09}, 'a', earlier) is None
    assert find_outlier({'mean_n': 5.11}, 'a', earlier)


def test_small_deviation_is_found_at_a_large_mean():
    level, small = 1e6, np.array([0.0, 1e-3, -1e-3] * 20)
    found = summarise_tension(level + small)
    assert found['mean_n'] == pytest.approx(level, rel=1e-15)
    exact = math.sqrt(math.fsum(v * v for v in small) / small.size)
    assert found['deviation_n'] == pytest.approx(exact, rel=1e-6)
    assert summarise_tension([]) == summarise_tension([1.0, math.nan]) == {}
