# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an experiment keeps of a trial, and what it does not."""

from types import SimpleNamespace

import pytest

from tactile_lab.experiment.bench import LiveBench
from tactile_lab.experiment.loop import TrialOrder
from tactile_lab.experiment.observer_node import ObserverNode
from tactile_msgs.msg import StrainBlock
from tactile_ros.errors import TactileError


def test_nothing_is_kept_while_a_person_thinks_about_a_failed_trial(context):
    observer = ObserverNode(context)
    block = StrainBlock(period_ns=10**7, tension_n=[1.0])

    def fail(request):
        observer._on_block(block)
        assert observer._blocks
        raise TactileError('the guide is not homed')

    plan = SimpleNamespace(
        protocol='texture', contacts=('flexion',), glide_speed_m_s=0.0, hold_s=0.0
    )
    planned = SimpleNamespace(session_id='s', contact='flexion', object_label='R1')
    rig = SimpleNamespace(
        recorder=SimpleNamespace(has_failed=False, save=lambda: None),
        operator=SimpleNamespace(tell_progress=lambda *_: None),
        others=[observer],
        run=fail,
    )
    bench = LiveBench(SimpleNamespace(simulated_rig=None), plan, None)
    with pytest.raises(TactileError, match='not homed'):
        bench.run_trial(rig, TrialOrder(planned, 't', 'm', 1, 1))
    observer._on_block(block)
    assert not observer._blocks
    observer.destroy_node()
