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

import numpy as np
import pytest

from tactile_classifier.intervals import accuracy_interval, difference_interval


def test_interval_of_many_trials_is_that_of_the_binomial():
    right = (np.arange(400) < 300).astype(float)
    interval = accuracy_interval(right, 'trials')
    half = 1.96 * np.sqrt(0.75 * 0.25 / 400)
    assert interval.low == pytest.approx(0.75 - half, abs=0.004)
    assert interval.high == pytest.approx(0.75 + half, abs=0.004)
    assert interval.method == 'bootstrap over 400 trials'


def test_no_error_is_not_certainty():
    interval = accuracy_interval(np.ones(60), 'trials')
    # The probability of no error in 60 trials at the lower limit is 2.5 %.
    assert interval.low**60 == pytest.approx(0.025)
    assert interval.high == 1.0
    nothing = accuracy_interval(np.zeros(60), 'trials')
    assert (nothing.low, nothing.high) == (0.0, pytest.approx(1 - interval.low))


def test_groups_without_spread_have_no_interval():
    interval = accuracy_interval(np.ones(6), 'groups')
    assert interval.to_dict() == {'reason': 'all 6 groups have the same accuracy'}
    assert difference_interval(np.zeros(9), 'trials').reason


def test_interval_covers_the_true_accuracy_about_as_often_as_it_says():
    generator = np.random.default_rng(5)
    covered = 0
    for _ in range(200):
        interval = accuracy_interval((generator.random(100) < 0.8).astype(float), 'trials')
        covered += interval.low <= 0.8 <= interval.high
    assert 180 <= covered <= 199


def test_paired_difference_keeps_its_sign():
    gains = np.r_[np.ones(30), -np.ones(2), np.zeros(68)]
    interval = difference_interval(gains, 'trials')
    assert 0.15 < interval.low < 0.28 < interval.high < 0.42
    turned = difference_interval(-gains, 'trials')
    assert turned.low == pytest.approx(-interval.high)
