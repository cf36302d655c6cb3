# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sensor node with a simulated load cell: topics, lifecycle, parameters and tare."""

import re

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from rclpy.lifecycle import TransitionCallbackReturn

from tactile_msgs.msg import TendonSlack, TrialEvent
from tactile_ros.qos import EVENTS, LATEST
from tactile_ros.strain import StrainStatus
from tendon_sensor_driver import encode_reading


def test_samples_arrive_and_a_lost_one_is_visible(graph, sensor):
    graph.bring_up()
    sensor.write(b'\n')
    numbers = [0, 1, 2, 4, 5]
    for number in numbers:
        sensor.write_reading(1000 + number * 1000 // 60, number / 10)
    graph.spin_until(lambda: len(graph.strain) == len(graph.wrench) == 5)
    assert [message.sequence for message in graph.strain] == numbers
    assert [message.lost_before for message in graph.strain] == [0, 0, 0, 1, 0]
    newtons = [number / 10 * 9.80665 for number in numbers]
    assert [list(message.tension_n) for message in graph.strain] == [[n] for n in newtons]
    assert [message.wrench.force.x for message in graph.wrench] == newtons
    for strain, wrench in zip(graph.strain, graph.wrench, strict=True):
        assert strain.header == wrench.header
        assert strain.header.frame_id == 'left_link'
    graph.spin_until(lambda: graph.values().get('lost_samples') == '1')
    status = graph.diagnostics[-1].status[0]
    assert (status.level, status.name) == (DiagnosticStatus.WARN, 'left/tendon_sensor')
    assert status.hardware_id == sensor.port


@pytest.mark.parametrize('simulated', [True, False])
def test_the_parameter_simulated_marks_every_sample(make_graph, sensor, simulated):
    graph, emitted = make_graph(sensor.port, simulated=simulated), []
    graph.node.emit = emitted.append
    graph.bring_up()
    sensor.write(b'\n')
    for i in range(3):
        sensor.write_reading(17 * i)
    graph.spin_until(lambda: len(graph.strain) == 3)
    marks = {bool(block.status & StrainStatus.SIMULATED) for block in (*graph.strain, *emitted)}
    assert marks == {simulated}


def test_deactivate_stops_the_samples_and_keeps_the_link(graph, sensor):
    graph.bring_up()
    sensor.write(b'\n')
    sensor.write_reading(0)
    graph.spin_until(lambda: graph.strain and graph.wrench)
    assert graph.node.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    sensor.write_reading(17)
    graph.spin_until(lambda: graph.values().get('readings') == '2')
    assert len(graph.strain) == len(graph.wrench) == 1

    assert graph.node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    sensor.write_reading(33)
    graph.spin_until(lambda: len(graph.strain) == 2)
    assert [message.sequence for message in graph.strain] == [0, 2]


def test_configure_fails_cleanly_without_a_port_and_works_once_there_is_one(graph, sensor):
    sensor.unplug()
    assert not graph.node.bring_up()
    sensor.plug_in()
    for _ in range(2):  # the port is closed by cleanup and opened again by configure
        graph.bring_up()
        sensor.write(b'\n')
        sensor.write_reading(0)
        graph.await_more()
        assert graph.node.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
        assert graph.node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
        assert graph.node.count_publishers('/left/tendon_sensor/strain') == 0


def test_a_tare_is_taken_off_and_latched_and_cleared(make_graph, sensor):
    graph = make_graph(sensor.port, tare_samples=5, unit='N', tare_spread_n=0.3, tare_change_n=0.5)
    graph.bring_up()
    graph.spin_until(lambda: graph.tares)
    assert not graph.tares[-1].is_set
    answer = graph.call('tare')
    assert not answer.success
    assert '0 of 5' in answer.message

    sensor.write(b'\n')
    for i, value in enumerate((0.5, 0.6, 0.5, 0.4, 0.5)):
        sensor.write(encode_reading(i * 17, value, 'N'))
    graph.spin_until(lambda: len(graph.strain) == 5)
    answer = graph.call('tare')
    assert answer.success, answer.message
    graph.spin_until(lambda: graph.tares[-1].is_set)
    state = graph.tares[-1]
    assert (state.samples, state.header.frame_id) == (5, 'left_link')
    assert state.bias_n == pytest.approx(0.5)
    assert state.spread_n == pytest.approx(0.0707, abs=1e-4)

    sensor.write(encode_reading(85, 5.0, 'N'))
    graph.spin_until(lambda: len(graph.strain) == len(graph.wrench) == 6)
    assert graph.strain[-1].tension_n[0] == graph.wrench[-1].wrench.force.x == 5.0 - state.bias_n
    answer = graph.call('tare')
    assert not answer.success
    assert re.search('tare_(change|spread|limit)_n', answer.message)
    assert graph.call('clear_tare').success
    graph.spin_until(lambda: not graph.tares[-1].is_set)
    sensor.write(encode_reading(102, 5.0, 'N'))
    graph.spin_until(lambda: len(graph.strain) == 7)
    assert graph.strain[-1].tension_n[0] == 5.0


def test_blocks_are_larger_only_while_the_tendon_is_reported_at_rest(graph, sensor):
    graph.bring_up()
    sensor.write(b'\n')
    slack = graph.listener.create_publisher(TendonSlack, '/left/tendon_actuator/slack', LATEST)
    written = 0

    def write(count):
        nonlocal written
        for _ in range(count):
            sensor.write_reading(written * 1000 // 60)
            written += 1
        graph.spin_until(lambda: sum(len(each.tension_n) for each in graph.strain) == written)

    write(3)
    assert [len(each.tension_n) for each in graph.strain] == [1, 1, 1]
    slack.publish(TendonSlack(state=TendonSlack.SLACK, at_rest=True))
    stage = graph.node.stage
    graph.spin_until(lambda: stage._is_at_rest)
    write(6)
    assert [len(each.tension_n) for each in graph.strain[3:]] == [3, 3]
    slack.publish(TendonSlack(state=TendonSlack.SLACK))  # the tendon is no longer at rest
    graph.spin_until(lambda: not stage._is_at_rest)
    write(2)
    assert [len(each.tension_n) for each in graph.strain[5:]] == [1, 1]
    slack.publish(TendonSlack(state=TendonSlack.SLACK, at_rest=True))
    graph.spin_until(lambda: stage._is_at_rest)
    graph.listener.destroy_publisher(slack)  # as if the tendon actuator had ended
    graph.spin_until(lambda: not stage._is_at_rest)
    write(2)
    assert [len(each.tension_n) for each in graph.strain[7:]] == [1, 1]


def test_the_serial_number_is_the_hardware_id(graph, monkeypatch):
    monkeypatch.setattr(
        'tendon_sensor_driver.line_sensor.find_serial_number', lambda port: 'A50285BI'
    )
    assert graph.node.bring_up()
    graph.spin_until(lambda: graph.diagnostics)
    assert graph.diagnostics[-1].status[0].hardware_id == 'A50285BI'


def test_a_tare_is_refused_while_the_tendon_is_taut_or_a_trial_runs(make_graph, sensor):
    graph = make_graph(sensor.port, tare_samples=5, unit='N')
    graph.bring_up()
    publish = graph.listener.create_publisher
    slack = publish(TendonSlack, '/left/tendon_actuator/slack', LATEST)
    events = publish(TrialEvent, '/left/trial_runner/events', EVENTS)

    def await_answer(name, text):
        graph.spin_until(lambda: text in graph.call(name).message)

    slack.publish(TendonSlack(state=TendonSlack.TAUT, displacement_m=0.0049))
    for name in ('tare', 'clear_tare'):
        await_answer(name, '4.9 mm')
    slack.publish(TendonSlack(state=TendonSlack.SLACK))
    events.publish(TrialEvent(trial_id='T1', phase=TrialEvent.PHASE_GLIDE))
    for name in ('tare', 'clear_tare'):
        await_answer(name, 'trial T1')
    events.publish(TrialEvent(trial_id='T1', phase=TrialEvent.PHASE_DONE))
    await_answer('tare', '0 of 5')
    slack.publish(TendonSlack(state=TendonSlack.TAUT))
    await_answer('tare', 'mm')
    graph.listener.destroy_publisher(slack)  # as if the tendon actuator had ended
    await_answer('tare', '0 of 5')
    assert graph.call('clear_tare').success
