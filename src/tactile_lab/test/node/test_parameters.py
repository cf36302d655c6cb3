# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A parameter is applied or refused, of every node."""

import dataclasses
from importlib.metadata import entry_points

import pytest
from rclpy.parameter import Parameter

from tactile_bringup.launch_config.graph import (
    ModelChoice,
    NodeDescription,
    Ports,
    recorder_node,
    rig_graph,
    slip_node,
)
from tactile_bringup.nodes.graph_runner import create_node
from tactile_ros.node_group import NodeGroup
from tactile_ros.node_program import GROUP
from tactile_sim.rig_process import SimulatedRig

EXECUTABLES = sorted({entry.name for entry in entry_points(group=GROUP)})


@pytest.fixture(scope='module')
def descriptions(stiffness_bag, trained, tmp_path_factory):
    """Give a description of every node, by its executable, with which it can be configured."""
    with SimulatedRig() as rig:
        ports = Ports(rig.ports.guide, rig.ports.tendon, rig.ports.sensor)
        recording = tmp_path_factory.mktemp('recordings') / 'bag'
        nodes = [
            *rig_graph(ports, ModelChoice.read(trained), {}, simulated=True),
            slip_node({}),
            recorder_node(recording, simulated=True),
            NodeDescription('bag_player', {'bag': str(stiffness_bag)}),
        ]
        yield {node.executable: node for node in nodes}


def changed(field, value):
    """Return another value that the field allows."""
    if field.metadata.get('choices'):
        return next(c for c in field.metadata['choices'] if c != value)
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return value + 'x'
    if isinstance(field.default, tuple):
        element = 7 if field.metadata.get('element') is int else 'x'
        return [*value, element]
    low, high = field.metadata['range']
    middle = type(value)((low + high) / 2)
    return middle if middle != value else low


def present(node, field):
    """Return the parameter as it is; ROS leaves an empty list without a value."""
    if node.get_parameter_or(field.name).value is not None:
        return node.get_parameter(field.name)
    types = Parameter.Type
    is_integer = field.metadata.get('element') is int
    return Parameter(field.name, types.INTEGER_ARRAY if is_integer else types.STRING_ARRAY, [])


@pytest.mark.parametrize('executable', EXECUTABLES)
def test_a_parameter_changes_between_configurations_only(executable, descriptions, context):
    assert executable in descriptions, f'describe {executable} above'
    description = descriptions[executable]
    node = create_node(description, context)
    fields = dataclasses.fields(node._config_class)
    own = [present(node, field) for field in fields]
    others = [
        Parameter(p.name, p.type_, changed(field, p.value))
        for field, p in zip(fields, own, strict=True)
    ]

    def refusals(parameters):
        results = node.set_parameters(parameters)
        return {p.name: r.reason for p, r in zip(parameters, results, strict=True)}

    with NodeGroup([node], context=context):
        assert not any(refusals(others).values())  # unconfigured: each is taken
        assert not any(refusals(own).values())
        assert node.bring_up()
        live = {field.name for field in fields if field.metadata.get('live')}
        for name, reason in refusals(others).items():
            if name in live:
                assert not reason
            else:
                assert f'{name} is read when the node is configured' in reason
                assert 'clean up the node first' in reason
        assert [present(node, f).value for f in fields if f.name not in live] == [
            p.value for p in own if p.name not in live
        ]
        qos = [name for name in node._parameters if name.startswith('qos_overrides')]
        for name in ('autostart', *qos):
            assert refusals([node.get_parameter(name)])[name], name
        assert not any(refusals([Parameter('use_sim_time', value=False)]).values())
        node.trigger_deactivate()
        node.trigger_cleanup()
        assert not any(refusals(others).values())
