# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The nodes classify a force that another node publishes over DDS. The tension is SIMULATED."""

from contextlib import contextmanager
import signal
import time

from geometry_msgs.msg import WrenchStamped
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from tactile_command import ask_tactile, hear_tactile, program

from tactile_analysis import TrialSet
from tactile_bags import TactileBag
from tactile_bags.message_records import read_records
from tactile_features.conversions import event_to_msg
from tactile_features.tactile_features_node import TactileFeaturesNode
from tactile_lab.commands.replay import replay_and_compare
from tactile_lab.commands.show import describe_recording
from tactile_msgs.msg import Classification, StrainBlock, TactileFeatures, TrialEvent
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_ros.topics import EVENT, STRAIN
from tactile_testing.waiting import wait_until

ANSWERS = 'tactile_classifier/classification'
SECOND_NS = 1_000_000_000


class Hand(Node):
    """Publishes the wrenches and the events of one recorded trial, as a robotic hand does."""

    def __init__(self, context, samples, events):
        super().__init__('broadcaster', context=context)
        self.force = self.create_publisher(WrenchStamped, '/ft/wrench', qos_profile_sensor_data)
        self.events = self.create_publisher(TrialEvent, 'trial_runner/events', EVENTS)
        self.answers = []
        self.create_subscription(Classification, ANSWERS, self.answers.append, RESULTS)
        self.strain = []
        self.create_subscription(StrainBlock, 'tendon_sensor/strain', self.strain.append, STREAM)
        self.waiting = sorted(
            [(at_ns, self.send_force, value) for at_ns, value in samples]
            + [(at_ns, self.send_event, event) for at_ns, event in events],
            key=lambda entry: entry[0],
        )
        self.offset_ns = 0

    def start(self):
        self.offset_ns = time.time_ns() - self.waiting[0][0]
        self.create_timer(0.001, self.send_due)

    def rest(self):
        """Publish the first force of the trial repeatedly, as if the hand touched nothing."""
        _, _, value = self.waiting[0]
        return self.create_timer(
            1 / 60, lambda: self.send_force(self.get_clock().now().to_msg(), value)
        )

    def send_due(self):
        while self.waiting and self.waiting[0][0] + self.offset_ns <= time.time_ns():
            at_ns, send, what = self.waiting.pop(0)
            send(Time(nanoseconds=at_ns + self.offset_ns).to_msg(), what)

    def send_force(self, stamp, value):
        message = WrenchStamped()
        message.header.stamp = stamp
        # Axis, sign and unit of this force differ from the tension, so the node must convert it.
        message.wrench.force.x = -value / 2
        self.force.publish(message)

    def send_event(self, stamp, event):
        event.header.stamp = stamp
        self.events.publish(event)


def read_trial(path):
    """Return samples and events of the first trial of a bag, without its approach phase."""
    samples, events = [], []
    with TactileBag(path) as bag:
        for message, record in read_records(bag.messages()):
            if message.type_name == STRAIN:
                samples += [
                    (record.stamp_ns + i * record.period_ns, float(value))
                    for i, value in enumerate(record.tension_n)
                ]
            elif message.type_name == EVENT:
                if events and record.trial_id != events[0][1].trial_id:
                    break
                events.append((record.stamp_ns, event_to_msg(record)))
    events = [entry for entry in events if entry[1].phase != 'approach']
    first_ns, last_ns = events[0][0] - SECOND_NS // 2, events[-1][0] + SECOND_NS // 10
    return [(at_ns, value) for at_ns, value in samples if first_ns <= at_ns <= last_ns], events


@pytest.fixture(autouse=True)
def _domain(context, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(context.get_domain_id()))


@contextmanager
def sensing(context, node, *options):
    """Run `tactile sense` and spin a node. Return a function that waits for a condition."""
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    with program('sense', *options) as process:

        def spin_until(condition):
            def step():
                assert process.poll() is None, process.communicate()
                executor.spin_once(timeout_sec=0.05)

            wait_until(condition, timeout_s=60.0, step=step)

        assert 'running: ' in process.stdout.readline()
        try:
            yield spin_until
        finally:
            executor.shutdown()
            node.destroy_node()
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors


def test_wrenches_of_another_node_are_classified_and_replay_equal(
    context, stiffness_bag, trained, tmp_path
):
    """Takes about 10 s, because a trial is sent in real time and replayed through nodes."""
    hand = Hand(context, *read_trial(stiffness_bag))
    (label,) = {what.object_label for _, send, what in hand.waiting if send == hand.send_event}
    params, bag = tmp_path / 'params.yaml', tmp_path / 'bag'
    params.write_text('tendon_sensor: {ros__parameters: {scale: -2.0}}')
    options = ('--sensor-topic', '/ft/wrench:fx', '--models', trained)
    with sensing(context, hand, *options, '--params', params, '--record', bag) as spin_until:
        spin_until(hand.force.get_subscription_count)
        # The subscribers are the feature node and the recorder.
        spin_until(lambda: hand.events.get_subscription_count() >= 2)
        spin_until(lambda: hand.count_publishers(ANSWERS))
        resting = hand.rest()
        # The sensor node measures the rate of the topic before it publishes samples.
        spin_until(lambda: hand.strain)
        resting.cancel()
        hand.start()
        spin_until(lambda: hand.answers)
    (answer,) = hand.answers
    assert answer.outcome == Classification.OUTCOME_LABEL, answer.reason
    assert answer.label == label
    assert answer.simulated
    (report,) = replay_and_compare(bag, trained, through_nodes=True, times=1)
    assert report.is_equal, report.to_dict()


def test_results_of_a_simulated_finger_are_marked_as_simulated(context, tmp_path):
    """The samples are marked as simulated, but the events are not, as in docs/on_your_hand.md."""
    bag = tmp_path / 'bag'
    hand = Node('hand', context=context)
    events = hand.create_publisher(TrialEvent, 'trial_runner/events', EVENTS)
    windows, blocks = [], []
    features = 'tactile_features/features'
    hand.create_subscription(TactileFeatures, features, windows.append, RESULTS)
    hand.create_subscription(StrainBlock, 'tendon_sensor/strain', blocks.append, STREAM)

    def state(phase):
        event = TrialEvent(trial_id='grasp-1', protocol='stiffness', phase=phase)
        event.contact = 'flexion'
        now = hand.get_clock().now()
        event.header.stamp = now.to_msg()
        events.publish(event)
        return now.nanoseconds

    with sensing(context, hand, '--simulated', '--record', bag) as spin_until:
        # The subscribers are the feature node and the recorder.
        spin_until(lambda: events.get_subscription_count() >= 2)
        spin_until(lambda: hand.count_publishers(features))
        spin_until(lambda: blocks)
        end_ns = state('hold') + 3 * SECOND_NS
        spin_until(lambda: Time.from_msg(blocks[-1].header.stamp).nanoseconds > end_ns)
        state('release')
        state('done')
        spin_until(lambda: windows)
    (window,) = windows
    assert window.simulated
    assert all(block.status & StrainBlock.STATUS_SIMULATED for block in blocks)
    with TactileBag(bag) as opened:
        assert opened.metadata['simulated'] is True
    with TrialSet.load(bag) as recording:
        contents = describe_recording(recording)
    assert contents.facts['simulated'] == 'SIMULATED'
    assert [trial['simulated'] for trial in contents.trials] == [True]


def test_events_from_the_shell_yield_a_window(context):
    """Each `tactile event` runs a separate node, as in a shell."""
    features = TactileFeaturesNode(context=context, namespace='index')
    hand = Node('hand', context=context, namespace='index')
    strain = hand.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
    windows = []
    topic = 'tactile_features/features'
    hand.create_subscription(TactileFeatures, topic, windows.append, RESULTS)
    trial = ('--trial', 'grasp-1', '--contact', 'flexion', '--object', 'sponge')
    with NodeGroup([features, hand], context):
        assert features.bring_up()
        # The feature node is in a namespace, so the command must state this namespace.
        refused = hear_tactile('event', 'hold', *trial, '--wait-s', 2, code=2)
        assert '--namespace /index' in refused
        begun = ask_tactile('event', 'hold', *trial, '--namespace', 'index')
        assert begun['received_by'] == ['/index/tactile_features']
        wait_until(lambda: time.time_ns() > begun['stamp_ns'] + 4 * SECOND_NS)
        ends = [
            ask_tactile('event', phase, *trial, '--namespace', 'index')['stamp_ns']
            for phase in ('release', 'done')
        ]
        wait_until(lambda: features.extractor.event_count == 3)
        wait_until(strain.get_subscription_count)
        period_ns = 16_666_667
        count = (ends[-1] - begun['stamp_ns'] + 2 * SECOND_NS) // period_ns
        samples = StrainBlock(
            period_ns=period_ns, tension_n=[3.0 - 1e-3 * i for i in range(count)]
        )
        samples.header.stamp = Time(nanoseconds=begun['stamp_ns'] - SECOND_NS).to_msg()
        strain.publish(samples)
        wait_until(lambda: windows)
    (window,) = windows
    assert (window.trial_id, window.contact) == ('grasp-1', 'flexion')
    assert window.outcome == TactileFeatures.OUTCOME_OK, window.reason
    held_ns = Time.from_msg(window.window_start).nanoseconds - begun['stamp_ns']
    assert 0 <= held_ns < 2 * SECOND_NS


def test_event_with_an_unknown_phase_is_refused():
    from tactile_lab.commands.event import PHASES

    known = {getattr(TrialEvent, n) for n in dir(TrialEvent) if n.startswith('PHASE_')}
    assert set(PHASES) == known - {TrialEvent.PHASE_PULL}
