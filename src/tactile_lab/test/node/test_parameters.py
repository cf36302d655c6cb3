# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of every node are applied or refused, through its parameter services."""

import dataclasses
from importlib.metadata import entry_points
import threading

from domain_coordinator import domain_id
import pytest
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter

from tactile_bringup.launch_config.graph import (
    ModelChoice,
    NodeDescription,
    Ports,
    recorder_node,
    rig_graph,
)
from tactile_bringup.nodes.graph_runner import create_node, ros_context
from tactile_ros.node_group import NodeGroup
from tactile_ros.node_program import GROUP
from tactile_sim.rig_process import SimulatedRig

DEADLINE_S = 20.0
EXECUTABLES = sorted({entry.name for entry in entry_points(group=GROUP)})


@pytest.fixture(scope='module')
def descriptions(stiffness_bag, trained, tmp_path_factory):
    """Return a valid description of every node; the keys are executables."""
    with SimulatedRig() as rig:
        ports = Ports(rig.ports.guide, rig.ports.tendon, rig.ports.sensor)
        recording = tmp_path_factory.mktemp('recordings') / 'bag'
        nodes = [
            *rig_graph(ports, ModelChoice.read(trained), {}, simulated=True),
            recorder_node(recording, simulated=True),
            NodeDescription('bag_player', {'bag': str(stiffness_bag)}),
        ]
        yield {node.executable: node for node in nodes}


class Peer:
    """Sets and reads the parameters of a node with its services, as another process does."""

    def __init__(self, node, name):
        self._set = node.create_client(SetParameters, f'/{name}/set_parameters')
        self._get = node.create_client(GetParameters, f'/{name}/get_parameters')

    def _call(self, client, request):
        assert client.wait_for_service(timeout_sec=DEADLINE_S)
        future, done = client.call_async(request), threading.Event()
        future.add_done_callback(lambda _: done.set())
        assert done.wait(DEADLINE_S)
        return future.result()

    def set(self, parameters):
        """Set parameters; return for each name why it was refused, or an empty text."""
        request = SetParameters.Request(parameters=[p.to_parameter_msg() for p in parameters])
        results = self._call(self._set, request).results
        return {
            p.name: '' if r.successful else r.reason
            for p, r in zip(parameters, results, strict=True)
        }

    def get(self, names):
        values = self._call(self._get, GetParameters.Request(names=names)).values
        return dict(zip(names, values, strict=True))


def changed(field, value):
    """Return another valid value of the field."""
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
    """Return the current parameter. In ROS, an empty list has no value."""
    if node.get_parameter_or(field.name).value is not None:
        return node.get_parameter(field.name)
    types = Parameter.Type
    is_integer = field.metadata.get('element') is int
    return Parameter(field.name, types.INTEGER_ARRAY if is_integer else types.STRING_ARRAY, [])


@pytest.mark.parametrize('executable', EXECUTABLES)
def test_parameters_change_only_while_the_node_is_unconfigured(executable, descriptions):
    assert executable in descriptions, f'describe {executable} above'
    description = descriptions[executable]
    with domain_id() as domain, ros_context(int(domain)) as context:
        node, other = create_node(description, context), Node('other', context=context)
        fields = dataclasses.fields(node._config_class)
        names = [field.name for field in fields]
        own = [present(node, field) for field in fields]
        others = [
            Parameter(p.name, p.type_, changed(field, p.value))
            for field, p in zip(fields, own, strict=True)
        ]
        peer = Peer(other, description.name)
        with NodeGroup([other], context=context), NodeGroup([node], context=context):
            assert not any(peer.set(others).values())  # while unconfigured, each value is accepted
            assert not any(peer.set(own).values())
            before = peer.get(names)
            assert node.bring_up()
            live = {field.name for field in fields if field.metadata.get('live')}
            for name, reason in peer.set(others).items():
                if name in live:
                    assert not reason
                else:
                    assert f'{name} is read when the node is configured' in reason
                    assert 'clean up the node first' in reason
            after = peer.get(names)
            assert {n: after[n] for n in names if n not in live} == {
                n: before[n] for n in names if n not in live
            }
            qos = [name for name in node._parameters if name.startswith('qos_overrides')]
            for name in ('autostart', *qos):
                assert peer.set([node.get_parameter(name)])[name], name
            assert not any(peer.set([Parameter('use_sim_time', value=False)]).values())
            node.trigger_deactivate()
            node.trigger_cleanup()
            assert not any(peer.set(others).values())
