# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sensor node with a force that another node publishes on a topic."""

import itertools
import math
import random
import re
import threading
import time

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data, QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import Float32, Float64

from tactile_ros.node_group import NodeGroup
from tactile_ros.stages import StageNode
from tactile_ros.strain import StrainStatus
from tendon_sensor_driver import check_sensor, TendonSensorConfig, topic_sensor

RELIABLE = QoSProfile(depth=1000)
SECOND_NS = 1_000_000_000


class Source(Node):
    """A node that publishes a force on the topic ``/force``."""

    def __init__(self, context, kind, profile=RELIABLE, name='broadcaster'):
        super().__init__(name, context=context)
        self.kind = kind
        self.force = self.create_publisher(kind, '/force', profile)

    def send(self, value, stamp_ns=0):
        message = self.kind()
        if hasattr(message, 'header'):
            message.header.stamp = Time(nanoseconds=stamp_ns).to_msg()
        if self.kind in (Float64, Float32):
            message.data = value
        elif self.kind is JointState:
            message.name, message.effort = ['other', 'tendon'], [0.0, value]
        else:
            message.wrench.force.z = value
        self.force.publish(message)


@pytest.fixture
def make_source(context):
    sources = []

    def make(*arguments, **options):
        # With its own context, the source can publish another type than the sensor node expects.
        theirs = Context()
        rclpy.init(context=theirs, domain_id=context.get_domain_id())
        sources.append(Source(theirs, *arguments, **options))
        return sources[-1]

    yield make
    for source in sources:
        source.destroy_node()
        source.context.try_shutdown()


@pytest.fixture
def topic_graph(make_graph):
    def make(**parameters):
        graph = make_graph('', **{'sensor': 'topic', 'topic': '/force', **parameters})
        graph.bring_up()
        return graph

    return make


def meet(graph, source):
    """Wait until publisher and subscription have matched, so that no message is lost."""
    graph.spin_until(lambda: source.force.get_subscription_count() == 1)
    graph.spin_until(lambda: 'True' in graph.values().get('is_connected', ''))
    subscription = graph.node.stage._client._subscription
    graph.spin_until(lambda: subscription.get_publisher_count() == 1)


def send_all(graph, source, samples):
    """Publish pairs of stamp and value as fast as the sensor node receives them."""
    for i, (stamp_ns, value) in enumerate(samples):
        source.send(value, stamp_ns)
        if i % 20 == 19:  # often enough that no queue overflows
            graph.executor.spin_once(timeout_sec=0.001)


def to_samples(messages):
    return {
        message.sequence + i: value
        for message in messages
        for i, value in enumerate(message.tension_n)
    }


def stamp_of(message):
    return Time.from_msg(message.header.stamp).nanoseconds


@pytest.mark.parametrize(
    ('kind', 'profile'),
    [(Float32, RELIABLE), (JointState, RELIABLE), (WrenchStamped, qos_profile_sensor_data)],
)
def test_each_type_becomes_tension_from_publishers_of_either_reliability(
    topic_graph, make_source, kind, profile
):
    source = make_source(kind, profile)
    graph = topic_graph(joint='tendon' if kind is JointState else '', scale=-1.0)
    meet(graph, source)
    now_ns = time.time_ns()
    for i in range(4):
        source.send(0.25 * i, now_ns + i * SECOND_NS // 60)
        graph.spin_until(lambda count=i + 1: len(graph.strain) == len(graph.wrench) == count)
    assert [list(m.tension_n) for m in graph.strain] == [[-0.25 * i] for i in range(4)]
    assert [m.wrench.force.x for m in graph.wrench] == [-0.25 * i for i in range(4)]
    assert [m.sequence for m in graph.strain] == list(range(4))
    assert {m.header.frame_id for m in graph.strain} == {'left_link'}
    has_stamp = kind in (WrenchStamped, JointState)
    for i, message in enumerate(graph.strain):
        assert bool(message.status & StrainStatus.HOST_TIME) == (not has_stamp)
        if has_stamp:
            assert stamp_of(message) == now_ns + i * SECOND_NS // 60
            assert message.stamp_error_s >= 0
        else:
            # The tolerance of 10 ms allows for small corrections of the host's clock.
            assert -SECOND_NS // 100 < stamp_of(message) - now_ns < 10 * SECOND_NS
            assert message.stamp_error_s == -1.0
    assert graph.diagnostics[-1].status[0].hardware_id == '/force'


def test_what_is_lost_late_or_twice_is_seen_and_a_pause_of_the_thread_costs_nothing(
    topic_graph, make_source, monkeypatch
):
    measure, calls = topic_sensor._measure_wait_ns, itertools.count()

    def measure_and_pause(info):
        pause_s = 0.15 if next(calls) == 20 else 0.0
        time.sleep(pause_s)
        wait_ns = measure(info)
        time.sleep(pause_s)
        return wait_ns

    monkeypatch.setattr(topic_sensor, '_measure_wait_ns', measure_and_pause)
    source = make_source(WrenchStamped)
    graph = topic_graph(rate_hz=250.0, samples_per_block=5)
    meet(graph, source)
    start_ns = time.time_ns() - SECOND_NS
    order = [*range(30), 29, 33, *range(35, 60), 34, *range(60, 101)]
    send_all(graph, source, [(start_ns + i * SECOND_NS // 250, float(i)) for i in order])
    graph.spin_until(lambda: 99 in to_samples(graph.strain))
    placed = sorted({*order} - {34})
    # Sample 34 arrived after sample 59. It counts as missing before sample 35 and is dropped.
    assert to_samples(graph.strain) == {i - (33 < i < 60): float(i) for i in placed[:-1]}
    names = ('duplicates', 'late_samples', 'lost_samples')
    graph.spin_until(lambda: [graph.values()[name] for name in names] == ['1', '1', '4'])


def test_a_publisher_that_stamps_when_it_sends_has_irregular_stamps(topic_graph, make_source):
    source = make_source(WrenchStamped)
    graph = topic_graph(rate_hz=250.0)
    meet(graph, source)
    period_ns = SECOND_NS // 250
    start_ns = time.time_ns() - SECOND_NS
    # One message in 40 is 1.6 periods late, and the message after it is 0.7 periods late.
    late = {20: 1.6, 21: 0.7}
    stamps_ns = [start_ns + round((i + late.get(i % 40, 0.0)) * period_ns) for i in range(240)]
    send_all(graph, source, [(stamp_ns, float(i)) for i, stamp_ns in enumerate(stamps_ns)])
    graph.spin_until(lambda: 239 in to_samples(graph.strain))
    assert to_samples(graph.strain) == {i: float(i) for i in range(240)}
    graph.spin_until(lambda: int(graph.values()['irregular_stamps']) >= 6)
    assert graph.values()['lost_samples'] == '0'


def test_numbers_that_are_none_are_marked_and_told(topic_graph, make_source):
    source = make_source(WrenchStamped)
    graph = topic_graph()
    meet(graph, source)
    now_ns = time.time_ns()
    values = [1.0, math.nan, 3e9]
    send_all(graph, source, [(now_ns + i * SECOND_NS // 60, v) for i, v in enumerate(values)])
    graph.spin_until(lambda: len(graph.strain) == 3)
    graph.await_health(DiagnosticStatus.ERROR)
    assert [m.status for m in graph.strain] == [0, *[StrainStatus.DEVICE_ERROR] * 2]
    source.send(1.0, now_ns + 3 * SECOND_NS // 60)
    graph.spin_until(lambda: len(graph.strain) == 4)
    assert graph.strain[-1].status == StrainStatus.OK


def test_a_publisher_that_is_missing_silent_gone_and_back_is_told(topic_graph, make_source):
    graph = topic_graph()
    graph.await_health(DiagnosticStatus.ERROR, '/force')
    source = make_source(WrenchStamped)
    graph.await_health(DiagnosticStatus.WARN, '/broadcaster')
    due_ns = time.time_ns()

    # All messages that are due are sent, so that the rate of their stamps is always 60 Hz.
    def send_what_is_due():
        nonlocal due_ns
        while due_ns < time.time_ns():
            source.send(random.random(), due_ns)
            due_ns += SECOND_NS // 60

    source.create_timer(1 / 60, send_what_is_due)
    theirs = SingleThreadedExecutor(context=source.context)
    theirs.add_node(source)
    at_their_rate = threading.Thread(target=theirs.spin)
    at_their_rate.start()
    graph.await_health(DiagnosticStatus.OK)
    theirs.shutdown()
    at_their_rate.join()
    source.destroy_publisher(source.force)
    heard = len(graph.strain)
    graph.await_health(DiagnosticStatus.ERROR, '/force')
    # The next publisher of the topic has another message type.
    other = make_source(Float64, name='other')
    meet(graph, other)
    other.send(7.0)
    graph.spin_until(lambda: len(graph.strain) > heard and graph.strain[-1].tension_n[0] == 7.0)
    assert graph.strain[-1].status & StrainStatus.RECONNECTED
    graph.spin_until(lambda: graph.values()['reconnects'] == '1')


def test_a_wrong_type_and_joint_states_without_effort_are_told(topic_graph, make_source):
    camera = make_source(Image, name='camera')
    graph = topic_graph(joint='thumb')
    graph.await_health(DiagnosticStatus.ERROR, 'sensor_msgs/msg/Image')
    camera.destroy_publisher(camera.force)
    source = make_source(JointState)
    meet(graph, source)

    def is_told():
        source.send(1.0)
        return re.search('joint thumb.* other, tendon', graph.sentence())

    graph.spin_until(is_told)
    assert graph.diagnostics[-1].status[0].level == DiagnosticStatus.WARN


def test_a_type_that_this_process_cannot_have_is_told(topic_graph, make_source):
    graph = topic_graph()
    graph.listener.create_subscription(Image, '/force', print, 10)
    make_source(WrenchStamped)
    graph.await_health(DiagnosticStatus.ERROR, '/force as geometry_msgs')


def test_a_quality_of_service_that_does_not_fit_is_told(topic_graph, make_source):
    make_source(WrenchStamped, qos_profile_sensor_data)
    graph = topic_graph(
        **{'qos_overrides./force.subscription.reliability': 'reliable'},
    )
    graph.await_health(DiagnosticStatus.ERROR, 'qos_overrides')
    # ROS 2 can discover the publisher before the name of its node is known.
    graph.spin_until(lambda: '/broadcaster' in graph.sentence())


def test_two_publishers_and_stamps_that_stand_still_are_told(topic_graph, make_source):
    source = make_source(WrenchStamped)
    graph = topic_graph(rate_hz=100.0, stuck_s=0.0)
    meet(graph, source)
    stood_ns = time.time_ns()

    def is_told(named):
        source.send(1.0, stood_ns)
        return named in graph.sentence()

    graph.spin_until(lambda: is_told('topic_stamps'))
    make_source(WrenchStamped, name='second')
    graph.spin_until(lambda: is_told('(/broadcaster, /second)'))


def test_the_rate_is_measured_and_said(topic_graph, make_source, capfd):
    source = make_source(WrenchStamped)
    graph = topic_graph(rate_hz=0.0)
    meet(graph, source)
    start_ns = time.time_ns() - 3 * SECOND_NS
    send_all(graph, source, [(start_ns + i * SECOND_NS // 250, float(i)) for i in range(750)])
    graph.spin_until(lambda: graph.strain and graph.strain[-1].tension_n[-1] == 749.0)
    assert graph.strain[0].period_ns == SECOND_NS // 250
    assert '250.000 Hz' in capfd.readouterr().err
    graph.spin_until(lambda: graph.values()['rate_hz'] == '250.0')


def test_deactivate_cleanup_and_configure_again(topic_graph, make_source):
    source = make_source(Float64)
    graph = topic_graph()
    meet(graph, source)
    assert graph.node.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    assert graph.node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
    graph.spin_until(lambda: source.force.get_subscription_count() == 0)
    graph.bring_up()
    meet(graph, source)
    source.send(1.5)
    graph.spin_until(lambda: graph.strain)


class Broadcaster(Source):
    """Publishes its force at 100 Hz, with regular stamps."""

    def __init__(self, context, kind):
        super().__init__(context, kind)
        self.due_ns = time.time_ns()
        self.create_timer(0.01, self.send_what_is_due)

    def send_what_is_due(self):
        while self.due_ns < time.time_ns():
            self.send(random.random(), self.due_ns)
            self.due_ns += SECOND_NS // 100


@pytest.mark.parametrize(
    ('kind', 'parameters'),
    [
        (WrenchStamped, {'rate_hz': 100.0}),
        (WrenchStamped, {'rate_hz': 0.0}),
        (Float64, {'rate_hz': 100.0, 'topic_stamps': 'arrival'}),
    ],
)
def test_a_force_on_a_topic_keeps_the_contract_of_all_sensors(context, kind, parameters):
    config = TendonSensorConfig(sensor='topic', topic='/force', **parameters)
    listener = StageNode('listener', TendonSensorConfig, context=context)
    with NodeGroup([listener, Broadcaster(context, kind)], context):
        check_sensor(
            lambda on_block, now_ns: topic_sensor.TopicClient(listener, config, on_block, now_ns)
        )


def test_the_node_does_not_listen_to_itself(make_graph):
    graph = make_graph('', sensor='topic', topic='tendon_sensor/wrench')
    assert not graph.node.bring_up()
    (result,) = graph.node.set_parameters([Parameter('topic', value='/force')])
    assert result.successful
    assert graph.node.bring_up()
