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

from linear_guide_driver.heartbeat import Heartbeat

MS = 1_000_000


def test_silence_is_told_from_the_start_and_its_beginning_once():
    heart = Heartbeat('the runner', 0.2)
    assert heart.describe_silence(0) == 'Nothing was heard of the runner for 0.2 s.'
    assert heart.take_loss(10_000 * MS) == ''  # nothing was ever there to lose
    heart.beat(1000 * MS)
    assert heart.describe_silence(1200 * MS) == ''
    assert heart.take_loss(1200 * MS) == ''
    assert heart.take_loss(1201 * MS) == 'Nothing was heard of the runner for 0.2 s.'
    assert heart.take_loss(1202 * MS) == ''
    assert heart.describe_silence(1202 * MS) != ''
    heart.beat(1300 * MS)
    assert heart.describe_silence(1300 * MS) == ''
    assert heart.take_loss(1501 * MS) != ''
