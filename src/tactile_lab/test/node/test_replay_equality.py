# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nodes publish the same messages for a recording, in one process or in several processes."""

from collections import Counter
from contextlib import contextmanager, ExitStack
import dataclasses
import json
import os
from pathlib import Path
import signal
import subprocess
from typing import NamedTuple

from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from tactile_analysis.datasets.feature_options import FeatureOptions
from tactile_analysis.datasets.feature_tables import read_tables
from tactile_bags import TactileBag
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.replay import replay_through_core, sensed_messages
from tactile_bringup.launch_config.graph import NodeDescription
from tactile_bringup.nodes.finger_node import connect_fingers
from tactile_bringup.nodes.graph_runner import create_node
from tactile_classifier import ModelSet
from tactile_classifier.conversions import classification_from_msg
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features import FeatureConfig, TrialFeatureExtractor
from tactile_features.conversions import (
    event_from_msg,
    feature_window_from_msg,
    strain_block_from_msg,
)
from tactile_features.model_contract import plan_features
from tactile_features.types import PHASES_STATED
from tactile_msgs.msg import Classification, StrainBlock, TactileFeatures, TrialEvent
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_ros.topics import EVENT, STRAIN
from tactile_testing.waiting import wait_until

START_S = 60.0
WORK_S = 60.0
BLOCKS, EVENTS_AT_ONCE = 30, 12
"""Limits for the numbers of strain blocks and trial events that the nodes have yet to process."""

BLOCKS_WITH_DETECTION = 10
"""Value of `BLOCKS` for trials that are detected in the tension. In this number of strain blocks,
the nodes detect fewer events than the queue of a subscriber can store."""

OUTPUTS = {
    'tactile_features/features': TactileFeatures,
    'tactile_features/detected_events': TrialEvent,
    'tactile_classifier/classification': Classification,
}
READERS = {
    TactileFeatures: feature_window_from_msg,
    TrialEvent: event_from_msg,
    Classification: classification_from_msg,
}


class Case(NamedTuple):
    bag: Path
    models: Path
    config: FeatureConfig

    def parameters(self):
        """Return the parameters of each node."""
        models = {'models': str(self.models)}
        of_features = {
            field.name: getattr(self.config, field.name)
            for field in dataclasses.fields(self.config)
            if getattr(self.config, field.name) != field.default
        }
        return {
            'tactile_features': {**of_features, **models},
            'tactile_classifier': models,
        }


@pytest.fixture(scope='module')
def texture(simulate_bag, tmp_path_factory):
    """Return a case with models for whole glides and for windows of their first seconds."""
    source = simulate_bag('texture', 'flexion', 4, seed=5, sessions=2)
    models = tmp_path_factory.mktemp('texture_models')
    for window_s in (0.5, 1.5, None):
        (table,) = read_tables([source], options=FeatureOptions(window_s=window_s)).values()
        write_model(models / f'{window_s}.npz', train(table, 'knn'))
    bag = simulate_bag('texture', 'flexion', 1, seed=6)
    with TactileBag(bag) as recording:
        config = recorded_features(recording).config
    return Case(bag, models, config)


@pytest.fixture(scope='module')
def stiffness(stiffness_bag, trained):
    """Return a case in which the feature node detects the phases of trials in the tension."""
    with TactileBag(stiffness_bag) as recording:
        config = recorded_features(recording).config
    return Case(stiffness_bag, trained, dataclasses.replace(config, phases='stiffness'))


def outputs_of_core(case):
    """Return, by topic, the results that are computed from the recording without ROS."""
    found = {topic: [] for topic in OUTPUTS}
    plan = plan_features(case.config, case.models)
    with TactileBag(case.bag) as bag:
        features = RecordedFeatures(case.config, plan.specs)
        models = ModelSet.load(case.models)
        results = replay_through_core(bag, models, features)
        extractor = TrialFeatureExtractor(case.config)
        for message in sensed_messages(bag):
            if message.type_name == STRAIN:
                extractor.add_block(strain_block_from_msg(message.decode()))
                found['tactile_features/detected_events'] += extractor.take_detected_events()
    found['tactile_features/features'] += results.windows
    found['tactile_classifier/classification'] += results.classifications
    return found


class Player:
    """Sends a recording to the nodes, and stores all messages that the nodes publish."""

    def __init__(self, context):
        self.node = Node('bag_player', context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.found = {topic: [] for topic in OUTPUTS}
        self.values = {}
        self.reports = Counter()  # number of diagnostic messages from each node
        for topic, kind in OUTPUTS.items():
            latched = EVENTS if kind is TrialEvent else RESULTS
            read, outputs = READERS[kind], self.found[topic]
            self.node.create_subscription(
                kind,
                topic,
                lambda message, read=read, outputs=outputs: outputs.append(read(message)),
                latched,
            )
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_health, 100)
        self.strain = self.node.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
        self.events = self.node.create_publisher(TrialEvent, 'trial_runner/events', EVENTS)

    def _on_health(self, message):
        for status in message.status:
            self.reports[status.name] += 1
            self.values[status.name] = {pair.key: pair.value for pair in status.values}

    def wait(self, condition, timeout_s=WORK_S):
        wait_until(
            condition,
            lambda: f'found {self.count()}, diagnostics {self.values}',
            timeout_s=timeout_s,
            step=lambda: self.executor.spin_once(timeout_sec=0.02),
        )

    def count(self):
        return {topic: len(outputs) for topic, outputs in self.found.items()}

    def is_matched(self, expected, strain_takers):
        resolve = self.node.resolve_topic_name
        return (
            all(
                self.node.count_publishers(resolve(topic)) for topic in expected if expected[topic]
            )
            and self.strain.get_subscription_count() >= strain_takers
            and self.events.get_subscription_count() >= 1
        )

    def send(self, case, take_block, has_taken, expected):
        """Send all messages of the recording; wait until the nodes have published all results."""
        sent, waiting = {STRAIN: 0, EVENT: 0}, {STRAIN: 0, EVENT: 0}
        most = BLOCKS if case.config.phases == PHASES_STATED else BLOCKS_WITH_DETECTION

        def is_taken():
            return has_taken(sent[STRAIN], sent[EVENT])

        with TactileBag(case.bag) as bag:
            for message in sensed_messages(bag):
                if message.type_name == STRAIN:
                    take_block(message)
                else:
                    self.events.publish(message.data)
                sent[message.type_name] += 1
                waiting[message.type_name] += 1
                if waiting[STRAIN] >= most or waiting[EVENT] >= EVENTS_AT_ONCE:
                    waiting = dict.fromkeys(waiting, 0)
                    self.wait(is_taken)
        self.wait(is_taken)
        self.wait(
            lambda: all(self.count()[topic] >= len(outputs) for topic, outputs in expected.items())
        )
        return self.found

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()


EXECUTABLES = {
    'tactile_features': ('tactile_features', 'tactile_features_node'),
    'tactile_classifier': ('tactile_classifier', 'tactile_classifier_node'),
}


@contextmanager
def nodes_of_one_process(case, context, *, has_sensor):
    """Run all nodes in this process. With ``has_sensor``, strain blocks are passed by calls."""
    nodes = {
        name: create_node(NodeDescription(name, case.parameters()[name]), context)
        for name in EXECUTABLES
    }
    connect_fingers(nodes.values())
    features, detected = nodes['tactile_features'], []
    features.is_fed_by_calls = has_sensor
    for node in nodes.values():
        assert node.bring_up()
    take_detected = features.extractor.take_detected_events

    def watched():
        events = take_detected()
        detected.extend(events)
        return events

    features.extractor.take_detected_events = watched
    with NodeGroup(nodes.values(), context=context):
        yield features, detected


def run_in_one_process(case, context, expected, *, has_sensor):
    player = Player(context)
    with nodes_of_one_process(case, context, has_sensor=has_sensor) as (features, detected):
        player.wait(lambda: player.is_matched(expected, 0 if has_sensor else 1))
        readers = [features.stage._events, *([] if has_sensor else features._polled)]
        # Publishers and subscribers must have found each other.
        player.wait(lambda: all(reader.get_publisher_count() for reader in readers))

        def call(message):
            features.add_block(strain_block_from_msg(message.decode()))

        def has_taken(blocks, events):
            extractor = features.extractor
            taken = extractor.block_count, extractor.event_count
            return (
                taken == (blocks, events)
                # Otherwise, the queue of the player's subscription could overflow.
                and len(player.found['tactile_features/detected_events']) == len(detected)
            )

        take = call if has_sensor else lambda message: player.strain.publish(message.data)
        found = player.send(case, take, has_taken, expected)
    player.close()
    return found


@contextmanager
def node_programs(case, context, folder):
    """Run each node in a separate process."""
    env = {**os.environ, 'ROS_DOMAIN_ID': str(context.get_domain_id())}
    processes = []
    try:
        for name, (package, executable) in EXECUTABLES.items():
            parameters = folder / f'{name}.yaml'
            stated = {
                key: list(value) if isinstance(value, tuple) else value
                for key, value in case.parameters()[name].items()
            }
            parameters.write_text(json.dumps({name: {'ros__parameters': stated}}))
            program = Path(get_package_prefix(package), 'lib', package, executable)
            command = [program, '--ros-args', '--params-file', parameters]
            processes.append(subprocess.Popen(command, env=env, start_new_session=True))
        yield
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
        codes = [process.wait(START_S) for process in processes]
    assert codes == [0] * len(EXECUTABLES)


def run_in_processes(case, context, expected, folder):
    player = Player(context)
    with ExitStack() as stack:
        stack.enter_context(node_programs(case, context, folder))
        player.wait(lambda: player.is_matched(expected, 1), START_S)
        # The processes discover the player a moment after it has discovered their publishers.
        player.reports.clear()
        player.wait(lambda: all(player.reports[name] >= 2 for name in EXECUTABLES), START_S)

        def has_taken(blocks, events):
            values = player.values.get('tactile_features', {})
            return (values.get('blocks'), values.get('events')) == (str(blocks), str(events))

        found = player.send(
            case, lambda message: player.strain.publish(message.data), has_taken, expected
        )
    player.close()
    return found


@pytest.mark.parametrize('name', ['texture', 'stiffness'])
def test_messages_do_not_depend_on_how_the_nodes_run(request, name, context, tmp_path):
    """Takes more than 10 s, because all trials are sent once per arrangement of the nodes."""
    case = request.getfixturevalue(name)
    expected = outputs_of_core(case)
    counts = Counter({topic: len(outputs) for topic, outputs in expected.items()})
    answers = expected['tactile_classifier/classification']
    if name == 'texture':
        assert counts['tactile_features/features'] == len(answers) == 24
    else:
        assert counts['tactile_features/detected_events'] > 30
        assert len(answers) == 15
    ways = {
        'calls': run_in_one_process(case, context, expected, has_sensor=True),
        'a process a finger': run_in_one_process(case, context, expected, has_sensor=False),
    }
    # Separate processes are tested for one case only, because they need seconds to start.
    if name == 'texture':
        ways['a process a node'] = run_in_processes(case, context, expected, tmp_path)
    for way, found in ways.items():
        for topic, outputs in expected.items():
            assert found[topic] == outputs, (way, topic)
