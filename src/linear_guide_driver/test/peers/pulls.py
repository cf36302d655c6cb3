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

"""A pull in the background, and how it ends."""

from background import Background

from linear_guide_driver import MotionFailedError
from waiting import wait_until


def begin_pull(tendon, servo, *arguments):
    """Return a pull by 20 mm that is on its way."""
    pull = Background(tendon.pull_to, 0.02, 0.01, *arguments)
    wait_until(lambda: servo.position > 2100)
    return pull


def check_failure(pull, text):
    error = pull.end()
    assert isinstance(error, MotionFailedError)
    assert text in str(error)
