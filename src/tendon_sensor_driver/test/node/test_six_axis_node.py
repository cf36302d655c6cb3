# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sensor node with a simulated Net F/T."""

from diagnostic_msgs.msg import DiagnosticStatus
from net_ft_device import HOST, NetFtBox, NetFtDevice
import numpy as np
import pytest


def test_the_tension_is_the_axis_the_wrench_is_turned_and_both_are_tared(make_graph):
    box = NetFtBox(np.full(7000, -1.25), serial='FT12345')
    with NetFtDevice(box) as device:
        graph = make_graph(
            '',
            sensor='net_ft',
            host=HOST,
            rdt_port=device.rdt_port,
            http_port=device.http_port,
            rate_hz=500.0,
            low_pass_hz=73,
            samples_per_block=5,
            scale=-1.0,
        )
        graph.bring_up()
        graph.await_more(20)
        graph.await_health(DiagnosticStatus.OK)
        assert {len(message.tension_n) for message in graph.strain} == {5}
        assert np.mean([m.tension_n for m in graph.strain]) == pytest.approx(1.25, abs=1e-3)
        graph.spin_until(lambda: graph.wrench)
        assert graph.wrench[-1].wrench.force.x == pytest.approx(1.25, abs=0.01)
        assert graph.wrench[-1].wrench.force.y == pytest.approx(0.0, abs=0.01)
        assert graph.wrench[-1].header.frame_id == 'left_link'
        assert graph.diagnostics[-1].status[0].hardware_id == 'FT12345'
        assert float(graph.values()['rate_hz']) == pytest.approx(500.0)
        answer = graph.call('tare')
        assert answer.success, answer.message
        graph.spin_until(lambda: graph.tares[-1].is_set)
        assert graph.tares[-1].bias_n == pytest.approx(1.25, abs=1e-3)
        graph.await_more(10)
        wrenches = len(graph.wrench)
        graph.spin_until(lambda: len(graph.wrench) > wrenches + 10)
        assert graph.strain[-1].tension_n[0] == pytest.approx(0.0, abs=0.01)
        assert graph.wrench[-1].wrench.force.x == pytest.approx(0.0, abs=0.01)
