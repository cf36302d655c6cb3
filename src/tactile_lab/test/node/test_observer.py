# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The trial backend and its observer: stored messages, mounting, errors."""

import os
from types import SimpleNamespace

import pytest

from tactile_bringup.nodes.operator_node import StoppedError
from tactile_bringup.trial_protocols import TrialRequest
from tactile_lab.experiment import live_rig
from tactile_lab.experiment.live_rig import LiveTrialBackend, ObserverNode
from tactile_lab.experiment.loop import Operator, TrialOrder
from tactile_lab.experiment.plan import ExperimentError, PlannedTrial
from tactile_lab.output import Output
from tactile_msgs.msg import StrainBlock
from tactile_ros.errors import TactileError
from tactile_sim.errors import RigError, TautTendonError

PLANNED = PlannedTrial('t', 's', 1, 1, 'flexion', 'R1')


@pytest.fixture
def bench(context):
    """Return a `LiveTrialBackend` whose trials call ``bench.fail``."""
    observer = ObserverNode(context)
    bench = LiveTrialBackend(
        SimpleNamespace(simulated_rig=None),
        None,
        lambda order: TrialRequest('texture', 'flexion', 'R1', order.trial_id, 's'),
    )
    bench._rig = SimpleNamespace(
        recorder=SimpleNamespace(has_failed=False, save=lambda: None),
        operator=SimpleNamespace(publish_progress=lambda *_: None),
        observer=observer,
        run=lambda request: bench.fail(request),
    )
    yield bench
    observer.destroy_node()


def test_no_data_are_kept_during_the_prompt_after_a_failed_trial(bench):
    observer, block = bench._rig.observer, StrainBlock(period_ns=10**7, tension_n=[1.0])

    def fail(request):
        observer._on_block(block)
        assert observer._blocks
        raise TactileError('the guide is not homed')

    bench.fail = fail
    with pytest.raises(TactileError, match='not homed'):
        bench.run_trial(TrialOrder(PLANNED, 't', 'm', 1, 1))
    observer._on_block(block)
    assert not observer._blocks


def test_trial_stopped_by_a_person_ends_the_loop(bench):
    def stop(request):
        raise StoppedError('the trial: cancelled')

    bench.fail = stop
    with pytest.raises(ExperimentError, match='cancelled'):
        bench.run_trial(TrialOrder(PLANNED, 't', 'm', 1, 1))


def test_object_is_mounted_once_the_driver_has_slackened_the_simulated_tendon(bench):
    refusals = [TautTendonError('the tendon is tightened by 4.9 mm')] * 3
    mounted = []

    def mount(*arguments):
        if refusals:
            raise refusals.pop()
        mounted.append(arguments)

    def fail(request):
        raise TactileError('the servo is silent')

    bench.fail = fail
    bench.setup.simulated_rig = SimpleNamespace(mount=mount)
    with pytest.raises(TactileError, match='the servo is silent'):
        bench.run_trial(TrialOrder(PLANNED, 't', 'm', 1, 1))
    assert mounted == [('texture', 'R1', 'flexion', None)]


def test_tendon_of_a_simulated_rig_that_stays_taut_fails_the_trial(bench, monkeypatch):
    def refuse(*_):
        raise TautTendonError('the tendon is tightened by 4.9 mm')

    monkeypatch.setattr(live_rig, 'SLACK_TIMEOUT_S', 0.0)
    bench.setup.simulated_rig = SimpleNamespace(mount=refuse)
    with pytest.raises(TactileError, match=r'tightened by 4\.9 mm'):
        bench.run_trial(TrialOrder(PLANNED, 't', 'm', 1, 1))


def test_mounting_is_not_repeated_if_the_simulated_rig_has_ended(bench):
    def end(*_):
        calls.append(1)
        raise RigError('the simulated rig ended with code 1')

    calls = []
    bench.setup.simulated_rig = SimpleNamespace(mount=end)
    with pytest.raises(TactileError, match='ended with code 1'):
        bench.run_trial(TrialOrder(PLANNED, 't', 'm', 1, 1))
    assert len(calls) == 1


@pytest.mark.parametrize('simulated_rig', [None, SimpleNamespace(mount=lambda *_: None)])
def test_error_on_a_simulated_rig_states_that_the_computer_is_busy(
    bench, monkeypatch, simulated_rig
):
    def fail(request):
        raise TactileError('the servo is silent.')

    bench.fail = fail
    bench.setup.simulated_rig = simulated_rig
    monkeypatch.setattr(os, 'getloadavg', lambda: (1000.0, 0.0, 0.0))
    with pytest.raises(TactileError) as raised:
        bench.run_trial(TrialOrder(PLANNED, 't', 'm', 1, 1))
    assert ('load 1000.0' in str(raised.value)) == (simulated_rig is not None)


def test_failed_trial_is_repeated_only_once():
    operator = Operator(Output(as_json=False))
    first, second = (TrialOrder(PLANNED, name, 'm', 1, 1) for name in ('t', 't-again1'))
    assert operator.choose(first, 'failed', 'no samples') == 'again'
    with pytest.raises(TactileError, match='no samples'):
        operator.choose(second, 'failed', 'no samples')
    assert operator.choose(second, 'outlier', '') == 'keep'
