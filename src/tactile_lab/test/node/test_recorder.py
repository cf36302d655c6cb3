# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from contextlib import contextmanager
import dataclasses
import errno
import os
from pathlib import Path
import signal
import subprocess
import sys
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from rclpy.duration import Duration
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message

from tactile_bags import TactileBag
from tactile_bags.bag_repair import repair_bag
from tactile_bags.errors import BagError
from tactile_bags.mcap_writer import McapWriter
from tactile_bags.nodes.bag_recorder_node import _Arrival
from tactile_bags.recorded_setup import recorded_features, WRITTEN_IN
from tactile_bringup.launch_config.graph import recorder_node
from tactile_bringup.nodes.graph_runner import create_node, running_graph
from tactile_features import FeatureConfig, spec_for
from tactile_features import FeatureSpecifications as Announced
from tactile_features.conversions import specifications_to_msg, strain_block_from_msg
from tactile_lab.experiment.live_rig import check_recording
from tactile_msgs.msg import FeatureSpecifications, RecordingAudit, StrainBlock, TrialEvent
from tactile_ros.errors import TactileError
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import EVENTS, LATEST, STREAM
from tactile_ros.topics import AUDIT, EVENT, SPECIFICATIONS, STRAIN
from tactile_testing.waiting import wait_until

DEADLINE_S = 10.0


class Source:
    """A node that publishes samples and events, and runs a recorder."""

    def __init__(self, context, namespace=''):
        self.context = context
        self.node = Node('source', context=context, namespace=namespace)
        self.strain = self.node.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
        self.events = self.node.create_publisher(TrialEvent, 'trial_runner/events', EVENTS)
        self.specifications = self.node.create_publisher(
            FeatureSpecifications, 'tactile_features/specifications', LATEST
        )

    def send(self, sequences):
        for i in sequences:
            self.strain.publish(strain_block(i, i * 10**7))

    @contextmanager
    def recorded(self, description, namespace='', **options):
        """Run a recorder of the published messages until the block ends."""
        graph = running_graph([description], self.context, others=[self.node], **options)
        with graph as nodes:
            (recorder,) = nodes.values()
            for publisher in (self.strain, self.events):
                wait_until(lambda publisher=publisher: publisher.get_subscription_count())
            topics = {f'{namespace}/tendon_sensor/strain', f'{namespace}/trial_runner/events'}
            wait_until(lambda: not topics & set(recorder.unmatched_topics()))
            yield recorder


def describe_recorder(path):
    return recorder_node(path)


def test_recording_contains_the_sent_bytes(context, tmp_path):
    source = Source(context, 'thumb')
    early = TrialEvent(trial_id='a', phase='approach')
    source.events.publish(early)  # sent before the recorder exists; the topic is latched
    blocks = [
        serialize_message(
            StrainBlock(sequence=i, period_ns=16_666_667, tension_n=[0.1 * i, -1e-300])
        )
        for i in range(200)
    ]
    path = tmp_path / 'bag'
    description = recorder_node(path, 'thumb', classifier=True)
    with source.recorded(description, '/thumb') as recorder:
        missing = recorder.unmatched_topics()
        assert '/thumb/tactile_features/features' in missing
        assert '/thumb/tactile_classifier/classification' in missing
        for block in blocks:
            source.strain.publish(block)
        wait_until(lambda: recorder.message_count == 201)
    with TactileBag(path) as bag:
        assert bag.metadata['simulated'] is False
        assert bag.namespaces == ('thumb',)
        assert [m.data for m in bag.messages(STRAIN)] == blocks
        assert [m.decode().trial_id for m in bag.messages(EVENT)] == ['a']


def test_messages_received_before_the_end_are_recorded(context, tmp_path):
    source = Source(context)
    path = tmp_path / 'bag'
    recorder = create_node(describe_recorder(path), context)
    recorder.poll_s = 1000.0  # as on a computer that is too busy to poll in time
    group = NodeGroup([recorder], context=context).__enter__()
    assert recorder.bring_up()
    wait_until(lambda: source.strain.get_subscription_count() == 1)
    source.send(range(10))
    assert source.strain.wait_for_all_acked(Duration(seconds=DEADLINE_S))
    group.close()
    source.node.destroy_node()
    with TactileBag(path) as bag:
        assert [m.decode().sequence for m in bag.messages(STRAIN)] == list(range(10))


def specifications(rate_hz):
    wanted = spec_for('stiffness', FeatureConfig(rate_hz=rate_hz))
    return specifications_to_msg(Announced((wanted,)))


def trial_event(phase, stamp_ns, trial_id='t'):
    event = TrialEvent(trial_id=trial_id, phase=phase)
    event.header.stamp.sec, event.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    return event


def strain_block(sequence, stamp_ns):
    block = StrainBlock(sequence=sequence, period_ns=10**7, tension_n=[1.0])
    block.header.stamp.sec, block.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    return block


def test_each_trial_is_audited_when_it_has_ended(context, tmp_path):
    source = Source(context)
    received = []
    source.node.create_subscription(RecordingAudit, 'bag_recorder/audit', received.append, EVENTS)
    path = tmp_path / 'bag'
    source.specifications.publish(specifications(100.0))
    with source.recorded(describe_recorder(path)) as recorder:
        wait_until(lambda: recorder.message_count == 1)
        source.events.publish(trial_event('approach', 10**9))
        source.events.publish(trial_event('done', 2 * 10**9))
        wait_until(lambda: recorder.message_count == 3)
        source.send(i for i in range(300) if i != 150)
        wait_until(lambda: received)
        assert not received[0].passed
        assert received[0].trial_id == 't'
        assert received[0].lost_count == received[0].gap_count == 1
        assert received[0].nominal_rate_hz == 100.0
        wait_until(lambda: recorder.message_count == 302)
    assert [audit.trial_id for audit in recorder.audits] == ['t', '']
    with TactileBag(path) as bag:
        assert bag.metadata['audit']['failed_trials'] == 1
        assert bag.metadata['audit']['whole'][0]['lost_count'] == 1
        assert [m.decode().trial_id for m in bag.messages(AUDIT)] == ['t', '']


def test_specifications_are_recorded_once_for_repeated_activations(context, tmp_path):
    source = Source(context)
    source.specifications.publish(specifications(100.0))
    with source.recorded(describe_recorder(tmp_path / 'bag')) as recorder:
        wait_until(lambda: recorder.message_count == 1)
        recorder.trigger_deactivate()
        recorder.trigger_activate()
        wait_until(source.specifications.get_subscription_count)
        source.specifications.publish(specifications(50.0))
        wait_until(lambda: recorder.message_count == 2)
    with TactileBag(tmp_path / 'bag') as bag:
        assert [m.decode().specifications[0].rate_hz for m in bag.messages(SPECIFICATIONS)] == [
            100.0,
            50.0,
        ]
        features = recorded_features(bag)
    assert [spec.rate_hz for spec in features.wanted] == [100.0, 50.0]


def test_messages_keep_their_order_when_the_clock_is_set_back(context, tmp_path, monkeypatch):
    source = Source(context)
    path = tmp_path / 'bag'
    with source.recorded(describe_recorder(path)) as recorder:
        real, set_back = recorder.get_clock(), []
        late = SimpleNamespace(now=lambda: real.now() - Duration(seconds=5.0 * len(set_back)))
        monkeypatch.setattr(recorder, 'get_clock', lambda: late)
        for i in range(30):
            if i in (10, 20):
                wait_until(lambda i=i: recorder.message_count == i)
                set_back.append(i)
            source.send([i])
        wait_until(lambda: recorder.message_count == 30)
    with TactileBag(path) as bag:
        messages = list(bag.messages(STRAIN))
    assert [message.decode().sequence for message in messages] == list(range(30))
    assert messages[-1].received_at_ns - messages[0].received_at_ns < 5e9


def test_recorder_names_missing_topics_and_requires_none_of_a_rig_on_a_hand(context, tmp_path):
    received = []
    listener = Node('listener', context=context)
    listener.create_subscription(DiagnosticArray, '/diagnostics', received.append, 10)
    description = describe_recorder(tmp_path / 'bag')
    parameters = {**description.parameters, 'rig': False, 'match_timeout_s': 0.0}
    on_hand = dataclasses.replace(description, parameters=parameters)
    with running_graph([on_hand], context, others=[listener]) as nodes:
        missing = nodes['bag_recorder'].unmatched_topics()
        wait_until(lambda: received)
    assert '/tendon_sensor/strain' in missing
    assert not any('linear_guide' in name or 'trial_runner' in name for name in missing)
    assert not any('tactile_classifier' in name for name in missing)
    (status,) = received[0].status
    assert status.level == DiagnosticStatus.ERROR
    assert 'no publisher of /tendon_sensor/strain' in status.message


def messages_on_disk(path):
    try:
        with TactileBag(path) as bag:
            return [message.decode().sequence for message in bag.messages(STRAIN)]
    except BagError:
        return []  # the bag does not exist yet


def test_bag_of_a_killed_recorder_can_be_opened(context, tmp_path):
    source = Source(context)
    path = tmp_path / 'bag'
    program = 'from tactile_bags.nodes.bag_recorder_node import main; main()'
    metadata = '{"simulated": true, "operator": "nobody"}'
    arguments = ['--ros-args', '-p', f'bag:={path}', '-p', f"metadata:='{metadata}'"]
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(context.get_domain_id())}
    with subprocess.Popen([sys.executable, '-c', program, *arguments], env=environment) as process:
        try:
            wait_until(lambda: messages_on_disk(path), step=lambda: source.send([0]))
            source.send(range(1, 100))
            # The file is copied while it is being written, as it would be after a crash.
            wait_until(lambda: messages_on_disk(path)[-1:] == [99])
            source.send(range(100, 150))
        finally:
            process.send_signal(signal.SIGKILL)
        process.wait(DEADLINE_S)
    source.node.destroy_node()
    sequences = messages_on_disk(path)
    last = sequences[-1]
    assert last >= 99
    # Message 0 was repeated until it was received.
    assert sequences[-last:] == list(range(1, last + 1))
    with TactileBag(path) as bag:
        assert 'never closed' in bag.recovered
        told = {'simulated': True, 'operator': 'nobody', WRITTEN_IN: str(path)}
        assert bag.metadata == told
    repair = repair_bag(path, tmp_path / 'repaired')
    assert repair.message_count == len(sequences)
    with TactileBag(tmp_path / 'repaired') as bag:
        assert bag.recovered is None
        assert bag.metadata['operator'] == 'nobody'
    assert messages_on_disk(tmp_path / 'repaired') == sequences


def full_disk(*_):
    raise OSError(errno.ENOSPC, 'No space left on device')


@pytest.mark.parametrize('failing', ['write', 'sync'])
def test_full_disk_ends_only_the_recording(context, tmp_path, monkeypatch, failing):
    source = Source(context)
    received, statuses, ends = [], [], []
    source.node.create_subscription(StrainBlock, 'tendon_sensor/strain', received.append, STREAM)
    source.node.create_subscription(DiagnosticArray, '/diagnostics', statuses.append, 10)
    description = describe_recorder(tmp_path / 'bag')

    def until_failed():
        with source.recorded(description, on_end=lambda: ends.append(1)) as recorder:
            wait_until(lambda: source.strain.get_subscription_count() == 2)
            source.send([0])
            wait_until(lambda: messages_on_disk(tmp_path / 'bag') == [0])
            with monkeypatch.context() as patch:
                patch.setattr(McapWriter, failing, full_disk)
                source.send([1])
                wait_until(lambda: recorder.is_finished)
            assert recorder.has_failed
            assert 'No space left' in recorder.failure
            with pytest.raises(TactileError, match='No space left'):
                check_recording(recorder)
            source.send(range(2, 5))
            wait_until(lambda: len(received) == 5)
            wait_until(
                lambda: any(
                    row.level == DiagnosticStatus.ERROR and 'No space left' in row.message
                    for array in statuses
                    for row in array.status
                )
            )
            assert not ends

    with pytest.raises(TactileError, match='failed while running: bag_recorder'):
        until_failed()
    assert messages_on_disk(tmp_path / 'bag')[0] == 0


def test_full_disk_at_the_end_is_reported(context, tmp_path, monkeypatch):
    recorder = create_node(describe_recorder(tmp_path / 'bag'), context)
    assert recorder.bring_up()
    monkeypatch.setattr(McapWriter, 'write_metadata', full_disk)
    recorder.take_down()
    assert recorder.has_failed
    assert 'as after killing' in recorder.failure


def test_recording_that_fails_at_the_start_is_refused_without_a_traceback(
    context, tmp_path, monkeypatch
):
    add_channel = McapWriter.add_channel

    def add_until_full(writer, topic):
        return full_disk() if topic.type_name == AUDIT else add_channel(writer, topic)

    monkeypatch.setattr(McapWriter, 'add_channel', add_until_full)
    recorder = create_node(describe_recorder(tmp_path / 'bag'), context)
    assert recorder.trigger_configure() == TransitionCallbackReturn.FAILURE
    recorder.take_down()


def test_recorder_process_exits_with_1_on_a_full_disk(context, tmp_path):
    source = Source(context)
    program = (
        'import sys\n'
        'from tactile_bags.nodes.bag_recorder_node import main\n'
        'from tactile_bags.mcap_writer import McapWriter\n'
        'def full(writer):\n'
        '    if writer._new_ns: raise OSError(28, "No space left on device")\n'
        'McapWriter.flush = full\n'
        'sys.exit(main())'
    )
    arguments = ['--ros-args', '-p', f'bag:={tmp_path / "bag"}']
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(context.get_domain_id())}
    with subprocess.Popen(
        [sys.executable, '-c', program, *arguments],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            wait_until(lambda: process.poll() is not None, step=lambda: source.send([0]))
            _, log = process.communicate(timeout=DEADLINE_S)
        finally:
            process.kill()
    source.node.destroy_node()
    assert process.returncode == 1
    assert 'No space left on device; 0 messages are saved' in log
    assert 'Traceback' not in log


def test_message_that_cannot_be_audited_is_recorded(context, tmp_path, monkeypatch):
    def stumble(msg):
        if msg.sequence == 1:
            raise ValueError('not that')
        return strain_block_from_msg(msg)

    monkeypatch.setattr('tactile_bags.nodes.bag_recorder_node.strain_block_from_msg', stumble)
    source = Source(context)
    path = tmp_path / 'bag'
    with source.recorded(describe_recorder(path)) as recorder:
        source.send(range(3))
        wait_until(lambda: recorder.message_count == 3)
    assert messages_on_disk(path) == [0, 1, 2]
    (audit,) = recorder.audits
    assert audit.sample_count == 2


def test_latched_event_is_recorded_if_the_recorder_is_activated_later(context, tmp_path):
    source = Source(context)
    source.events.publish(TrialEvent(trial_id='early', phase='approach'))
    recorder = create_node(describe_recorder(tmp_path / 'bag'), context)
    recorder.trigger_configure()
    with NodeGroup([source.node, recorder], context=context):
        wait_until(lambda: '/trial_runner/events' not in recorder.unmatched_topics())
        assert recorder.message_count == 0
        recorder.trigger_activate()
        wait_until(lambda: recorder.message_count == 1)
        recorder.trigger_deactivate()
        source.events.publish(TrialEvent(trial_id='early', phase='done'))
        recorder.trigger_activate()
        wait_until(lambda: recorder.message_count >= 2)


def recorded_events(path):
    with TactileBag(path) as bag:
        return [(e.trial_id, e.phase) for e in (m.decode() for m in bag.messages(EVENT))]


def test_reactivated_recorder_omits_trials_of_the_previous_bag(context, tmp_path):
    source = Source(context)
    at_ns = iter(range(10**9, 10**11, 10**9))

    def publish(trial_id, *phases):
        for phase in phases:
            source.events.publish(trial_event(phase, next(at_ns), trial_id))

    recorder = create_node(describe_recorder(tmp_path / 'bag'), context)
    recorder.trigger_configure()
    with NodeGroup([source.node, recorder], context=context):

        def activate():
            recorder.trigger_activate()
            wait_until(lambda: '/trial_runner/events' not in recorder.unmatched_topics())
            wait_until(source.events.get_subscription_count)

        publish('old', 'approach', 'hold', 'done')
        activate()
        publish('a', 'approach')
        wait_until(lambda: recorder.message_count == 1)
        recorder.trigger_deactivate()
        publish('a', 'done')
        publish('between', 'approach', 'done')
        publish('b', 'approach')
        activate()
        publish('b', 'hold')
        wait_until(lambda: recorder.message_count == 4)
        recorder.trigger_deactivate()
        activate()  # all messages are already recorded
        publish('b', 'release')
        wait_until(lambda: recorder.message_count == 5)
        recorder.trigger_deactivate()
        recorder.trigger_cleanup()
        audited = [audit.trial_id for audit in recorder.audits]
        recorder.set_parameters([Parameter('bag', value=str(tmp_path / 'next'))])
        recorder.trigger_configure()
        activate()
        publish('b', 'done')
        wait_until(lambda: recorder.message_count == 9)
    recorder.take_down()
    a = [('a', 'approach'), ('a', 'done')]
    b = [('b', phase) for phase in ('approach', 'hold', 'release', 'done')]
    assert recorded_events(tmp_path / 'bag') == [*a, *b[:3]]
    assert recorded_events(tmp_path / 'next') == b
    assert not {'old', 'between'} & set(audited)


def test_late_message_stays_in_order_of_its_topic(context):
    """Messages of a latched topic may arrive after a newer message."""
    recorder = create_node(describe_recorder(Path('unused')), context)
    arrivals = [
        ('events', 3.0),
        ('events', 1.0),
        ('strain', 2.0),
        ('events', 4.0),
        ('strain', 2.5),
    ]
    taken = [
        recorder._in_order(_Arrival(topic, b'', round(at_s * 1e8), 0)) for topic, at_s in arrivals
    ]
    assert [a.received_ns / 1e8 for a in taken] == [3.0, 3.0, 2.0, 4.0, 2.5]
    set_back = recorder._in_order(_Arrival('events', b'', -(10**10), 0))
    assert set_back.received_ns == -(10**10)
    recorder.take_down()
