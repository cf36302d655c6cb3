# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The feature node with model files: what it announces, and what it says of the files."""

import dataclasses
from functools import partial
import json

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from tactile_features import FeatureConfig, spec_for, TrialFeatureExtractor, WantedFeatures
from tactile_features.conversions import specifications_from_msg
from tactile_features.tactile_features_node import TactileFeaturesNode
from tactile_msgs.msg import FeatureSpecifications
from tactile_ros.qos import LATEST
from tactile_testing.waiting import wait_until

FULL = WantedFeatures(spec_for('texture', FeatureConfig()), (60, 120))
SHORT = WantedFeatures(spec_for('texture', FeatureConfig(texture_samples=90)))


@pytest.fixture
def make_node(context):
    made = []

    def make(**parameters):
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        made.append(TactileFeaturesNode(context=context, parameter_overrides=overrides))
        return made[-1]

    yield make
    for node in made:
        node.take_down()


@pytest.fixture
def listen(context):
    """Return a function that hears what a node says after it was configured."""
    peer = Node('peer', context=context)

    def listen(node):
        announced, health = [], []
        peer.create_subscription(
            FeatureSpecifications, 'tactile_features/specifications', announced.append, LATEST
        )
        peer.create_subscription(
            DiagnosticArray, '/diagnostics', lambda message: health.append(message.status[0]), 10
        )
        executor = SingleThreadedExecutor(context=context)
        for each in (node, peer):
            executor.add_node(each)
        wait_until(
            lambda: announced and health, step=partial(executor.spin_once, timeout_sec=0.05)
        )
        executor.shutdown()
        return specifications_from_msg(announced[-1]), health[-1]

    yield listen
    peer.destroy_node()


def test_the_specifications_are_there_for_who_comes_late_to_an_inactive_node(make_node, listen):
    node = make_node(texture_samples=120, partial_samples=[60])
    node.trigger_configure()
    announced, _ = listen(node)
    config = FeatureConfig(texture_samples=120, partial_samples=(60,))
    assert announced.wanted == TrialFeatureExtractor(config).wanted
    assert FeatureConfig(**announced.config) == config
    assert announced.stamp_ns > 0


def test_the_models_decide_and_a_broken_file_is_named(
    make_node, listen, make_model_file, tmp_path, capfd
):
    make_model_file(tmp_path / 'a.onnx', FULL)
    make_model_file(tmp_path / 'b.onnx', SHORT)
    make_model_file(tmp_path / 'c.onnx', SHORT, 'abduction')
    (tmp_path / 'broken.onnx').write_bytes(b'hello')
    node = make_node(
        models=str(tmp_path), contact='flexion', texture_samples=240, samples_timeout_s=2.0
    )
    assert node.bring_up()
    announced, health = listen(node)
    hold = WantedFeatures(spec_for('stiffness', FeatureConfig()))
    assert announced.wanted == (FULL, SHORT, hold)
    # A replay takes what was announced, and nothing else.
    config = FeatureConfig(**json.loads(json.dumps(announced.config)))
    again = TrialFeatureExtractor(config, announced.wanted)
    assert (again.config, again.wanted) == (node.extractor.config, announced.wanted)
    assert config.samples_timeout_s == 2.0
    assert dataclasses.replace(config, texture_samples=180, samples_timeout_s=5.0) == (
        FeatureConfig()
    )
    log = capfd.readouterr().err
    assert f'model {tmp_path / "broken.onnx"} is refused' in log
    assert 'the models decide: texture_samples 180 and 90 (not 240)' in log
    assert health.level == DiagnosticStatus.WARN
    assert str(tmp_path / 'broken.onnx') in health.message
    values = {pair.key: pair.value for pair in health.values}
    assert (values['refused model files'], values['specifications']) == ('1', '3')


def test_without_a_usable_model_it_is_not_configured_and_says_why(make_node, tmp_path, capfd):
    assert not make_node(models=str(tmp_path)).bring_up()
    assert f'there are no model files (*.onnx) in {tmp_path}' in capfd.readouterr().err
