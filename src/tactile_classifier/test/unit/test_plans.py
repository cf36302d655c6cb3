# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

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
