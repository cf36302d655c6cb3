# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The program that runs the nodes of a finger or a hand: parameters from a file, and its end."""

import os
from pathlib import Path
import signal
import subprocess

from ament_index_python.packages import get_package_prefix
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from tactile_bringup.nodes.finger_node import describe, NODES
from tactile_msgs.msg import StrainBlock
from tactile_ros.errors import TactileError
from tactile_ros.node_program import find_node_class
from tactile_ros.qos import STREAM
from tactile_sim.rig_process import SimulatedRig
from tactile_testing.waiting import wait_until

PROGRAM = Path(get_package_prefix('tactile_bringup'), 'lib', 'tactile_bringup', 'finger_node')
DEADLINE_S = 60.0
FINGERS = ('index', 'middle')


def start(context, *arguments, stderr=subprocess.PIPE):
    return subprocess.Popen(
        [PROGRAM, *arguments],
        env={**os.environ, 'ROS_DOMAIN_ID': str(context.get_domain_id())},
        stderr=stderr,
        text=True,
    )


@pytest.fixture
def ear(context):
    node = Node('ear', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield node, lambda: executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    node.destroy_node()


def test_a_hand_runs_with_the_parameters_of_a_file_and_a_finger_without_its_device_comes_later(
    context, ear, tmp_path
):
    """Takes about ten seconds: two programs start, and a missing device is retried after 5 s."""
    node, spin = ear
    heard = {finger: [] for finger in FINGERS}
    for finger in FINGERS:
        topic = f'/left/{finger}/tendon_sensor/strain'
        node.create_subscription(StrainBlock, topic, heard[finger].append, STREAM)
    params = tmp_path / 'hand.yaml'
    params.write_text(
        ''.join(
            f'/left/{finger}/tendon_sensor:\n  ros__parameters:\n'
            f'    port: {tmp_path / finger}/sensor\n    frame_id: tip_of_{finger}\n'
            for finger in FINGERS
        )
    )
    log = tmp_path / 'log'
    rigs = SimulatedRig(1, tmp_path / 'index'), SimulatedRig(2, tmp_path / 'unplugged')
    with rigs[0], rigs[1], log.open('w') as stderr:
        nodes = [f'/left/{f}/{n}' for f in FINGERS for n in ('tendon_sensor', 'tactile_features')]
        process = start(context, *nodes, '--ros-args', '--params-file', str(params), stderr=stderr)
        try:
            wait_until(lambda: heard['index'], timeout_s=DEADLINE_S, step=spin)
            assert not heard['middle']
            wait_until(lambda: 'not running yet: left/middle/tendon_sensor' in log.read_text())
            (tmp_path / 'middle').symlink_to(tmp_path / 'unplugged')
            wait_until(lambda: heard['middle'], timeout_s=DEADLINE_S, step=spin)
            told = f'running: {", ".join(name.strip("/") for name in nodes)}'
            wait_until(lambda: told in log.read_text(), timeout_s=DEADLINE_S)
            for finger in FINGERS:
                assert heard[finger][0].header.frame_id == f'tip_of_{finger}'
            process.send_signal(signal.SIGINT)
            assert process.wait(DEADLINE_S) == 0, log.read_text()
        finally:
            process.kill()


def test_without_autostart_the_nodes_wait_for_a_lifecycle_manager(context, ear, tmp_path):
    node, spin = ear
    params = tmp_path / 'hand.yaml'
    params.write_text('/**: {ros__parameters: {autostart: false}}')
    process = start(
        context, '/tendon_sensor', '/tactile_features', '--ros-args', '--params-file', str(params)
    )
    try:
        wait_until(
            lambda: {'tendon_sensor', 'tactile_features'} <= set(node.get_node_names()),
            timeout_s=DEADLINE_S,
            step=spin,
        )
        # The sensor has no device. If it had been configured, it would have failed and ended the
        # process.
        assert not node.count_publishers('/tactile_features/features')
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=DEADLINE_S)
    finally:
        process.kill()
    assert process.returncode == 0, errors


def test_what_cannot_be_started_ends_the_process_with_one(context):
    process = start(context, '/tactile_features', '--ros-args', '-p', 'max_gap_samples:=-1')
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1, errors
    assert 'max_gap_samples' in errors


def test_every_name_is_that_of_a_node():
    for name in NODES:
        node = describe(f'/a/b/{name}')
        assert (node.name, node.namespace) == (name, 'a/b')
        assert find_node_class(node.executable).__module__.endswith(f'.{name}_node')
    with pytest.raises(TactileError, match='no node x'):
        describe('x')


def test_a_process_without_nodes_says_how_to_name_them(context):
    process = start(context)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1, errors
    assert 'give names such as /tendon_sensor' in errors
