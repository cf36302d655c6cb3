# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node with a simulated Net F/T over real UDP and HTTP."""

from net_ft_box import NetFtBox
from net_ft_device import HOST, NetFtDevice
import numpy as np
import pytest


@pytest.fixture
def box():
    box = NetFtBox(np.full(7000, -1.25), serial='FT12345', noise_counts=500.0)
    with NetFtDevice(box) as device:
        yield device


@pytest.fixture
def graph(make_graph, box):
    graph = make_graph(
        '',
        sensor='net_ft',
        host=HOST,
        rdt_port=box.rdt_port,
        http_port=box.http_port,
        rate_hz=500.0,
        low_pass_hz=73,
        samples_per_block=5,
        scale=-1.0,
    )
    assert graph.node.bring_up()
    graph.spin_until(graph.is_matched)
    graph.spin_until(lambda: len(graph.strain) > 20 and graph.sentence() == 'samples arrive')
    return graph


def test_the_tension_is_the_axis_and_the_wrench_beside_it_is_turned(graph):
    assert {len(message.tension_n) for message in graph.strain} == {5}
    assert np.mean([m.tension_n for m in graph.strain]) == pytest.approx(1.25, abs=1e-3)
    assert graph.wrench[-1].wrench.force.x == pytest.approx(1.25, abs=0.01)
    assert graph.wrench[-1].wrench.force.y == pytest.approx(0.0, abs=0.01)
    assert graph.wrench[-1].header.frame_id == 'left_link'
    assert graph.diagnostics[-1].status[0].hardware_id == 'FT12345'
    assert float(graph.values()['rate_hz']) == pytest.approx(500.0)


def test_the_tare_holds_for_tension_and_wrench(graph):
    graph.spin_until(lambda: len(graph.strain) > 20)
    answer = graph.call('tare')
    assert answer.success, answer.message
    graph.spin_until(lambda: graph.tares[-1].is_set)
    assert graph.tares[-1].bias_n == pytest.approx(1.25, abs=1e-3)
    first = len(graph.strain)
    graph.spin_until(lambda: len(graph.strain) > first + 10 and len(graph.wrench) > first + 10)
    assert graph.strain[-1].tension_n[0] == pytest.approx(0.0, abs=0.01)
    assert graph.wrench[-1].wrench.force.x == pytest.approx(
        graph.strain[-1].tension_n[-1], abs=0.01
    )
