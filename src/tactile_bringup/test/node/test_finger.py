# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The nodes of a finger in one process call each other directly."""

from collections import Counter
from dataclasses import replace
import os
import termios
import threading
import time
import tty

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from std_srvs.srv import Trigger

from tactile_bringup.launch_config.graph import NodeDescription
from tactile_bringup.nodes.finger_node import connect_fingers, sources_last
from tactile_bringup.nodes.graph_runner import create_node
from tactile_msgs.msg import StrainBlock, TactileFeatures, TrialEvent
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_testing.waiting import wait_until
from tendon_sensor_driver import encode_reading

DEADLINE_S = 10.0


class Board:
    """Simulated load cell, which writes readings to a pseudo-terminal in short bursts."""

    def __init__(self, port, rate_hz):
        self.port, self.rate_hz = str(port), rate_hz
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.symlink(os.ttyname(self._slave), self.port)
        self._burst = max(1, int(rate_hz // 100))
        self._end = threading.Event()
        self.count = 0
        self.value = lambda number: 0.5 + 0.001 * (number % 7)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        begin_s = time.monotonic()
        while not self._end.wait(max(0, begin_s + self.count / self.rate_hz - time.monotonic())):
            lines = b''
            for _ in range(self._burst):
                ticks = round(self.count * 1e6 / self.rate_hz)
                lines += encode_reading(ticks, self.value(self.count), 'N')
                self.count += 1
            while lines and not self._end.is_set():
                lines = lines[os.write(self._master, lines) :]

    def stop(self):
        self._end.set()
        os.set_blocking(self._master, False)
        self._thread.join(DEADLINE_S)

    def close(self):
        self._end.set()
        termios.tcflush(self._slave, termios.TCIOFLUSH)  # unblocks a pending write
        self.stop()
        os.close(self._master)
        os.close(self._slave)


class Finger:
    """Sensor node and feature node in one process, and all samples that the feature node took."""

    def __init__(self, context, board, namespace='', **of_features):
        descriptions = [
            NodeDescription(
                'tendon_sensor',
                {
                    'port': board.port,
                    'unit': 'N',
                    'rate_hz': float(board.rate_hz),
                    'time_unit_s': 1e-6,
                    'stuck_s': 0.0,
                },
            ),
            NodeDescription('tactile_features', {'rate_hz': float(board.rate_hz), **of_features}),
        ]
        self.nodes = {
            d.name: create_node(replace(d, namespace=namespace), context) for d in descriptions
        }
        self.sensor, self.features = self.nodes.values()
        connect_fingers(self.nodes.values())
        for _, node in sources_last(self.nodes):
            assert node.bring_up()
        self.taken = []
        self.during_block = lambda: None
        add_block = self.features.extractor.add_block

        def watched(block):
            self.taken += range(block.sequence, block.sequence + len(block.tension_n))
            self.during_block()
            return add_block(block)

        self.features.extractor.add_block = watched
        self.group = NodeGroup(self.nodes.values(), context=context).__enter__()


@pytest.fixture
def make_board(tmp_path):
    boards = []

    def make(rate_hz):
        boards.append(Board(tmp_path / f'board_{len(boards)}', rate_hz))
        return boards[-1]

    yield make
    for board in boards:
        board.close()


@pytest.fixture
def make_finger(context, make_board):
    fingers = []

    def make(rate_hz=60.0, **options):
        board = make_board(rate_hz)
        fingers.append(Finger(context, board, **options))
        fingers[-1].board = board
        wait_until(lambda: fingers[-1].taken)
        return fingers[-1]

    yield make
    for finger in fingers:
        finger.group.close()


@pytest.fixture
def elsewhere(context):
    """Return a node with a DDS participant of its own, as in another process."""
    other = Context()
    rclpy.init(context=other, domain_id=context.get_domain_id())
    node = Node('elsewhere', context=other)
    yield node
    node.destroy_node()
    rclpy.try_shutdown(context=other)


def assert_each_once(taken):
    first, last = taken[0], taken[-1]
    assert [n for n, times in Counter(taken).items() if times > 1] == []
    assert taken == list(range(first, last + 1))


def test_nothing_is_built_until_somebody_subscribes_and_then_the_next_sample_comes(
    make_finger, elsewhere
):
    finger = make_finger(60)
    strain = finger.sensor.stage._strain
    # Wait until no subscriber of an earlier test is left.
    wait_until(lambda: not strain._publisher.get_subscription_count())
    built, emitted = [], []
    to_message, emit = strain._to_message, finger.sensor.stage._emit

    def build(block):
        built.append(block.sequence)
        return to_message(block)

    def note(block):
        emitted.append((block.sequence, strain._publisher.get_subscription_count()))
        emit(block)

    strain._to_message, finger.sensor.stage._emit = build, note
    wait_until(lambda: len(emitted) >= 10)
    assert built == []
    heard = []
    elsewhere.create_subscription(
        StrainBlock, 'tendon_sensor/strain', lambda m: heard.append(m.sequence), STREAM
    )
    executor = rclpy.executors.SingleThreadedExecutor(context=elsewhere.context)
    executor.add_node(elsewhere)
    wait_until(lambda: len(heard) >= 10, step=lambda: executor.spin_once(timeout_sec=0.05))
    executor.shutdown()
    # The feature node ignores samples of another publisher on the topic.
    publisher = elsewhere.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
    wait_until(lambda: finger.sensor.count_publishers('/tendon_sensor/strain') >= 2)
    publisher.publish(StrainBlock(sequence=10**6, period_ns=10**7, tension_n=[9.0]))
    count = len(finger.taken)
    wait_until(lambda: len(finger.taken) > count + 10)
    finger.board.stop()
    finger.group.close()
    assert_each_once(finger.taken)
    with_subscriber = [sequence for sequence, count in emitted if count]
    # The subscriber may have appeared after the publisher checked for subscribers.
    assert heard[0] in (with_subscriber[0], with_subscriber[0] + 1)
    assert heard == list(range(heard[0], heard[0] + len(heard)))
    assert built[: len(heard)] == heard


@pytest.mark.parametrize('end', ['cleanup', 'shutdown', 'process'])
def test_the_end_of_features_waits_for_the_block_that_they_work_on(make_finger, end):
    finger = make_finger(1000)
    in_block, go = threading.Event(), threading.Event()

    def hold():
        in_block.set()
        assert go.wait(DEADLINE_S)

    def deactivate_and_clean_up():
        finger.features.trigger_deactivate()
        finger.features.trigger_cleanup()

    ways = {
        'cleanup': deactivate_and_clean_up,
        'shutdown': finger.features.trigger_shutdown,
        'process': finger.group.close,
    }
    finger.during_block = hold
    assert in_block.wait(DEADLINE_S)
    ending = threading.Thread(target=ways[end], daemon=True)
    ending.start()
    go.set()
    ending.join(DEADLINE_S)
    assert not ending.is_alive()
    finger.board.stop()
    finger.group.close()
    assert_each_once(finger.taken)


def test_a_fault_of_a_stage_ends_the_process_as_in_a_callback_of_its_own(make_finger):
    finger = make_finger(60)

    def fail():
        raise ZeroDivisionError('a bug')

    finger.during_block = fail
    assert finger.group.ended.wait(DEADLINE_S)
    assert isinstance(finger.group.error, ZeroDivisionError)


def test_a_restarted_feature_node_goes_on_with_the_next_block(make_finger):
    finger = make_finger(1000)
    for _ in range(5):
        finger.features.trigger_deactivate()
        finger.features.trigger_cleanup()
        assert finger.features.bring_up()
        extractor = finger.features.extractor
        wait_until(lambda extractor=extractor: extractor.block_count > 2)
        assert extractor.late_sample_count == extractor.restart_count == 0
    assert finger.sensor.stage._client.health().lost_samples == 0


def test_tare_and_events_come_in_the_middle_of_blocks(make_finger, elsewhere):
    finger = make_finger(1000)
    in_block, go = threading.Event(), threading.Event()
    executor = rclpy.executors.SingleThreadedExecutor(context=elsewhere.context)
    executor.add_node(elsewhere)
    spin = lambda: executor.spin_once(timeout_sec=0.05)  # noqa: E731
    windows = []
    elsewhere.create_subscription(
        TactileFeatures, 'tactile_features/features', windows.append, RESULTS
    )
    events = elsewhere.create_publisher(TrialEvent, 'trial_runner/events', EVENTS)
    client = elsewhere.create_client(Trigger, 'tendon_sensor/tare')
    wait_until(lambda: client.service_is_ready() and events.get_subscription_count() >= 1)
    wait_until(lambda: len(finger.taken) > 1100)

    def hold():
        in_block.set()
        assert go.wait(DEADLINE_S)
        finger.during_block = lambda: None

    finger.during_block = hold
    assert in_block.wait(DEADLINE_S)
    stamp_ns = finger.sensor.now_ns()
    for phase, at_ns in (('hold', stamp_ns - 10**9), ('done', stamp_ns - 10**8)):
        event = TrialEvent(phase=phase, trial_id='t', protocol='stiffness')
        event.header.stamp.sec, event.header.stamp.nanosec = divmod(at_ns, 10**9)
        events.publish(event)
    answer = client.call_async(Trigger.Request())
    go.set()
    wait_until(answer.done, step=spin)
    wait_until(lambda: windows, step=spin)
    executor.shutdown()
    assert windows[0].trial_id == 't'
    finger.board.stop()
    finger.group.close()
    assert_each_once(finger.taken)


def test_a_publisher_that_blocks_holds_up_no_request(make_finger):
    """A reliable publisher can block for 0.1 s per message; at 7 kHz a message has 70 samples."""
    finger = make_finger(7000)
    publish = finger.sensor.stage._strain.publish
    finger.sensor.stage._strain.publish = lambda block: (time.sleep(0.1), publish(block))
    count = len(finger.taken)
    wait_until(lambda: len(finger.taken) > count + 500)
    assert finger.features.trigger_deactivate().name == 'SUCCESS'
    assert finger.features.trigger_activate().name == 'SUCCESS'
    finger.sensor.stage._strain.publish = publish
    count = len(finger.taken)
    wait_until(lambda: len(finger.taken) > count + 2000)
    assert finger.sensor.trigger_deactivate().name == 'SUCCESS'
    assert finger.sensor.trigger_cleanup().name == 'SUCCESS'
    assert [n for n, times in Counter(finger.taken).items() if times > 1] == []


def test_two_fingers_of_one_process_do_not_mix(context, make_board):
    fingers = []
    for number, name in enumerate(('left', 'right')):
        board = make_board(60)
        board.value = lambda _, number=number: 1.0 + number
        fingers.append(Finger(context, board, namespace=f'robot/{name}'))
    for number, finger in enumerate(fingers):
        wait_until(lambda finger=finger: len(finger.taken) > 30)
        samples = finger.features.extractor._buffer.samples['tension_n']
        assert set(samples[5:].tolist()) == {1.0 + number}
        finger.group.close()
