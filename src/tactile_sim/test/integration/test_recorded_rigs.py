# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A rig behaves the same if it advances step by step or directly to the next event."""

import numpy as np
import pytest
from rig_scripts import load_recorded, run_by_events, run_by_steps, SCRIPTS

from tactile_sim.physics import trials
from tactile_sim.rig import PalpationRig


@pytest.mark.parametrize('name', SCRIPTS)
def test_the_same_commands_at_the_same_steps_give_the_same_bytes_and_motion(name):
    recorded, told = load_recorded(name), run_by_events(SCRIPTS[name])
    assert told.said == recorded.said
    # The tolerance allows for another rounding of ``exp`` than on the computer of the recording.
    np.testing.assert_allclose(told.truth, recorded.truth, rtol=1e-9, atol=1e-12)
    by_steps = run_by_steps(SCRIPTS[name])
    assert told.said == by_steps.said
    np.testing.assert_array_equal(told.truth, by_steps.truth)


def test_nothing_is_solved_while_nothing_moves(monkeypatch):
    rig = PalpationRig(seed=1)
    rig.advance(0.1)

    def refuse(*_):
        raise AssertionError('solved at rest')

    monkeypatch.setattr(trials, 'advance_trials', refuse)
    rig.advance(10.0)
    assert rig.sensor.poll(10.0).count(b'kg') >= 600
