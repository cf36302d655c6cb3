# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The observer only stores the required messages of a trial."""

from types import SimpleNamespace

import pytest

from tactile_bringup.nodes.operator_node import StoppedError
from tactile_bringup.trial_protocols import TrialRequest
from tactile_lab.experiment.live_rig import LiveTrialBackend, ObserverNode
from tactile_lab.experiment.loop import Operator, TrialOrder
from tactile_lab.experiment.plan import ExperimentError, PlannedTrial
from tactile_lab.output import Output
from tactile_msgs.msg import StrainBlock
from tactile_ros.errors import TactileError

PLANNED = PlannedTrial('t', 's', 1, 1, 'flexion', 'R1')


@pytest.fixture
def bench(context):
    """Return a bench whose rig runs what `bench.fail` raises."""
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


def test_nothing_is_kept_while_a_person_thinks_about_a_failed_trial(bench):
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


def test_a_trial_that_somebody_stopped_ends_the_loop(bench):
    def stop(request):
        raise StoppedError('the trial: cancelled')

    bench.fail = stop
    with pytest.raises(ExperimentError, match='cancelled'):
        bench.run_trial(TrialOrder(PLANNED, 't', 'm', 1, 1))


def test_a_trial_is_run_once_more_and_not_twice():
    operator = Operator(Output(as_json=False))
    first, second = (TrialOrder(PLANNED, name, 'm', 1, 1) for name in ('t', 't-again1'))
    assert operator.choose(first, 'failed', 'no samples') == 'again'
    with pytest.raises(TactileError, match='no samples'):
        operator.choose(second, 'failed', 'no samples')
    assert operator.choose(second, 'outlier', '') == 'keep'
