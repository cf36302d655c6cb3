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

import re

import pytest

from linear_guide_driver.motion_track import MotionSummary
from tactile_bringup.records import TrialConfig
from tactile_bringup.trial_observation import judge_glide, TendonContact
from tactile_features.config import FeatureConfig

CONFIG = TrialConfig()


def contact(*states):
    watched = TendonContact()
    watched.begin(0.0049, CONFIG.displacement_tolerance_m)
    for stamp_ns, displacement_m, velocity_m_s in states:
        watched.take(stamp_ns, displacement_m, velocity_m_s)
    return watched


def test_a_contact_begins_with_the_first_state_at_rest():
    pull = [(1, 0.001, 0.01), (2, 0.0046, 0.01), (3, 0.0048, 0.0002), (4, 0.0049, 0.0)]
    watched = contact(*pull)
    assert watched.rest_ns == 3
    assert watched.error_m == pytest.approx(0.0001)
    assert watched.describe_loss() == ''
    assert contact(*pull[:2]).rest_ns is None


def test_a_state_from_before_the_rest_does_not_count():
    assert contact((3, 0.0049, 0.0), (2, 0.0010, 0.01)).describe_loss() == ''


def test_a_tendon_that_leaves_its_displacement_is_told_with_the_numbers():
    watched = contact((1, 0.0049, 0.0), (2, 0.0043, -0.01))
    assert 'wound in by 0.0043 m instead of 0.0049 m' in watched.describe_loss()
    watched.end()
    watched.take(3, 0.0, 0.0)
    assert (watched.describe_loss(), watched.error_m) == ('', 0.0)


@pytest.mark.parametrize(
    ('summary', 'sentence'),
    [
        (MotionSummary(0.01501, 0.005), ''),
        (MotionSummary(0.0152, 0.0), 'at 0.01520 m/s instead of 0.015 m/s'),
        (MotionSummary(0.0148, 0.04), 'at 0.01480 m/s instead of 0.015 m/s'),
        (MotionSummary(0.0149, 0.04), 'fell 0.040 s behind'),
        (None, 'too few positions'),
    ],
)
def test_a_glide_is_judged_by_speed_and_lag(summary, sentence):
    problem = judge_glide(summary, 0.015, CONFIG)
    assert re.search(re.escape(sentence), problem) if sentence else problem == ''


def test_the_tolerances_are_those_that_move_a_spectral_line_by_a_bin():
    features = FeatureConfig()
    bin_hz = features.rate_hz / features.texture_samples
    highest_hz = features.rate_hz / 2
    assert CONFIG.speed_tolerance == pytest.approx(bin_hz / highest_hz, rel=0.02)
    assert CONFIG.lag_tolerance_s == pytest.approx(1 / highest_hz, rel=0.02)
