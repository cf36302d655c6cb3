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

import pytest

from linear_guide_driver.errors import MotionRefusedError
from linear_guide_driver.tension_guard import TensionGuard, Verdict

MS = 1_000_000


@pytest.fixture
def guard():
    return TensionGuard({'flexion': 15.0, 'abduction': 3.0}, 0.25, is_optional=True)


@pytest.fixture
def strict():
    return TensionGuard({'flexion': 15.0, 'abduction': 3.0}, 0.25)


def begin(guard, contact='flexion', stop_tension_n=0.0, is_release=False, now_ns=0):
    guard.begin(contact, stop_tension_n, is_release, now_ns)


def test_the_contact_chooses_the_limit(guard):
    begin(guard, 'flexion')
    assert not guard.add_samples([14.9], False, 0)
    guard.add_samples([2.0], False, 0)
    begin(guard, 'abduction')
    assert guard.add_samples([3.1], False, 0)
    assert guard.check(0) is Verdict.OVER_LIMIT
    assert '3.10 N, is above the limit, 3.0 N' in guard.describe()


def test_crossing_the_limit_is_said_once(guard):
    begin(guard, 'abduction')
    said = [guard.add_samples([n], False, 0) for n in (2.9, 3.1, 5.0, 2.0, 3.2)]
    assert said == [False, True, False, False, True]


def test_the_limit_holds_between_pulls_and_is_strict_before_the_first(guard):
    assert guard.add_samples([3.1], False, 0)
    guard.add_samples([0.0], False, 0)
    begin(guard, 'flexion')
    guard.end()
    assert not guard.add_samples([10.0], False, 0)
    assert guard.add_samples([15.1], False, 0)


def test_a_limit_lowered_below_a_stale_tension_still_trips(guard):
    begin(guard, 'flexion')
    guard.add_samples([5.0], False, 0)
    begin(guard, 'abduction', now_ns=1000 * MS)  # the 5 N are too old to refuse
    assert guard.add_samples([5.0], False, 1001 * MS)


def test_saturation_counts_as_over_the_limit(guard):
    begin(guard)
    assert guard.add_samples([1.0], True, 0)


def test_the_stop_tension_ends_the_pull_at_or_above(guard):
    guard.add_samples([0.1], False, 0)
    begin(guard, stop_tension_n=5.0)
    guard.add_samples([4.999], False, 0)
    assert guard.check(0) is Verdict.CONTINUE
    guard.add_samples([5.0], False, 0)
    guard.add_samples([4.0], False, 0)
    assert guard.check(0) is Verdict.REACHED
    assert guard.describe() == 'The tension reached 5.00 N.'


def test_without_a_stop_tension_no_tension_below_the_limit_ends_it_while_samples_arrive(strict):
    strict.add_samples([0.1], False, 0)
    begin(strict)
    strict.add_samples([14.0], False, 100 * MS)
    assert strict.check(350 * MS) is Verdict.CONTINUE
    assert strict.check(351 * MS) is Verdict.NO_SAMPLES


def test_a_pull_without_samples_is_refused_unless_they_are_optional(strict):
    with pytest.raises(MotionRefusedError, match='set the parameter unguarded to true'):
        begin(strict)
    begin(strict, is_release=True)
    assert strict.check(10_000 * MS) is Verdict.CONTINUE
    with pytest.raises(MotionRefusedError, match=r'start the sensor\.$'):
        begin(strict, stop_tension_n=5.0)


def test_where_samples_are_optional_a_pull_goes_on_without(guard):
    begin(guard)
    assert guard.check(10_000 * MS) is Verdict.CONTINUE


def test_every_sample_of_a_block_counts_in_both_signs(guard):
    guard.add_samples([0.1], False, 0)
    begin(guard, 'abduction')
    assert guard.add_samples([0.1, 3.1, 0.2], False, 0)
    assert guard.tension_n == 0.2
    assert not guard.add_samples([0.1], False, 0)
    assert guard.add_samples([-3.1, 0.1], False, 0)
    assert not guard.add_samples([], False, 0)


def test_a_target_is_checked_like_a_stop_and_excludes_it(guard):
    guard.add_samples([0.1], False, 0)
    for target_n in (15.1, float('nan'), -1.0):
        with pytest.raises(MotionRefusedError, match='Target tension'):
            guard.begin('flexion', 0.0, False, 0, target_n)
    with pytest.raises(MotionRefusedError, match='set one of them to 0'):
        guard.begin('flexion', 5.0, False, 0, 5.0)
    guard.begin('flexion', 0.0, False, 0, 12.0)
    assert guard.live_tension_n(250 * MS) == 0.1
    assert guard.live_tension_n(251 * MS) is None


def test_a_stop_tension_needs_a_live_sensor(guard):
    with pytest.raises(MotionRefusedError, match='needs the tendon sensor'):
        begin(guard, stop_tension_n=5.0)
    guard.add_samples([0.1], False, 0)
    begin(guard, stop_tension_n=5.0, now_ns=250 * MS)
    assert guard.check(250 * MS) is Verdict.CONTINUE
    assert guard.check(251 * MS) is Verdict.NO_SAMPLES
    assert guard.describe() == 'No valid strain sample arrived for 0.25 s.'


@pytest.mark.parametrize(
    ('contact', 'stop_tension_n', 'text'),
    [
        ('sideways', 0.0, 'must be one of flexion, abduction'),
        ('abduction', 3.5, 'between 0 and the abduction limit'),
        ('flexion', -1.0, 'between 0'),
        ('flexion', float('nan'), 'between 0'),
    ],
)
def test_impossible_pulls_are_refused(guard, contact, stop_tension_n, text):
    guard.add_samples([0.1], False, 0)
    with pytest.raises(MotionRefusedError, match=text):
        begin(guard, contact, stop_tension_n)


def test_over_the_limit_only_a_release_is_allowed_and_it_is_not_interrupted(guard):
    begin(guard, 'abduction')
    guard.add_samples([4.0], False, 0)
    with pytest.raises(MotionRefusedError, match='release the tendon first'):
        begin(guard, 'abduction')
    begin(guard, 'abduction', is_release=True)
    assert not guard.add_samples([4.0], False, 0)
    assert guard.check(0) is Verdict.CONTINUE
    guard.end()
    assert guard.add_samples([4.0], False, 0)


def test_what_is_no_number_is_no_sample(strict):
    strict.add_samples([0.1], False, 0)
    assert not strict.add_samples([float('nan'), 20.0], False, 1000 * MS)
    assert strict.tension_n == 0.1
    assert not strict.is_alive(1000 * MS)
