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

"""An interrupt ends the parts of an evaluation that are under way, before it ends the process."""

import threading

import pytest

from tactile_classifier.evaluation.plans import run_plans


class TwoParts:
    """One part ends at once; the other one still computes when the interrupt comes."""

    def __init__(self):
        self.begun, self.interrupted, self.ended = (threading.Event() for _ in range(3))

    def tasks(self):
        return [(self.begun.wait, (10.0,)), (self.compute, ())]

    def compute(self):
        self.begun.set()
        assert self.interrupted.wait(10.0)
        threading.Event().wait(0.2)
        self.ended.set()

    def finish(self, answers):
        raise AssertionError('it was interrupted')


def test_an_interrupt_waits_for_the_parts_that_are_under_way():
    plan = TwoParts()

    def interrupt(done, total):
        plan.interrupted.set()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_plans([plan], 2, interrupt)
    assert plan.ended.is_set()
