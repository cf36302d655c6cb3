# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from dataclasses import dataclass, field

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.parameter import Parameter

from tactile_ros.lifecycle import read_config, TactileNode
from tactile_testing.requests import send
from tactile_testing.waiting import wait_until


@dataclass(frozen=True)
class Config:
    rate_hz: float = field(
        default=60.0, metadata={'description': 'rate', 'unit': 'Hz', 'range': (1.0, 100.0)}
    )
    unit: str = field(default='kg', metadata={'description': 'unit', 'choices': ('kg', 'g')})
    count: int = field(default=3, metadata={'description': 'count', 'range': (1, 10)})
    names: tuple[str, ...] = field(default=(), metadata={'description': 'names'})
    path: str = field(default='', metadata={'description': 'path'})
    gain: float = field(default=1.0, metadata={'description': 'gain', 'live': True})

    def __post_init__(self) -> None:
        if self.path == 'nowhere':
            raise ValueError('path is "nowhere"; name a place')


class RecordingNode(TactileNode):
    def __init__(self, **options):
        super().__init__('recording', Config, **options)
        self.calls = []
        self.failure = ''

    def set_up(self, config):
        self.calls.append('set_up')
        if self.failure == 'set_up':
            raise RuntimeError('no such device')

    def start(self):
        self.calls.append('start')
        if self.failure == 'start':
            raise RuntimeError('device is off')

    def stop(self):
        self.calls.append('stop')

    def tear_down(self):
        self.calls.append('tear_down')


@pytest.fixture
def make_node(context):
    nodes = []

    def make(**overrides):
        parameters = [Parameter(k, value=v) for k, v in overrides.items()]
        node = RecordingNode(context=context, parameter_overrides=parameters)
        nodes.append(node)
        return node

    yield make
    for node in nodes:
        node.destroy_node()


def test_parameters_carry_name_default_and_description_of_the_config(make_node):
    node = make_node()
    assert read_config(node, Config) == Config()
    description = node.describe_parameter('rate_hz')
    assert description.description == 'rate [Hz]'
    assert description.floating_point_range[0].to_value == 100.0


def test_overrides_reach_the_config(make_node):
    node = make_node(rate_hz=10.0, unit='g', count=4, names=['a', 'b'])
    assert read_config(node, Config) == Config(10.0, 'g', 4, ('a', 'b'))


@pytest.mark.parametrize(
    ('error', 'bad'),
    [
        (InvalidParameterValueException, {'rate_hz': 0.5}),
        (InvalidParameterValueException, {'rate_hz': 0}),
        (InvalidParameterValueException, {'count': 11}),
        (InvalidParameterTypeException, {'rate_hz': True}),
        (InvalidParameterTypeException, {'rate_hz': '60'}),
        (InvalidParameterTypeException, {'count': 3.0}),
    ],
)
def test_a_wrong_value_is_refused_at_the_start(make_node, error, bad):
    with pytest.raises(error, match=next(iter(bad))):
        make_node(**bad)


def is_float(node, value):
    present = read_config(node, Config).rate_hz
    return type(present) is float and present == value


def test_an_integer_is_taken_where_a_float_is_wanted(make_node):
    node = make_node(rate_hz=60, gain=-2)
    assert is_float(node, 60.0)
    assert node.get_parameter('gain').value == -2.0
    assert all(r.successful for r in node.set_parameters([Parameter('rate_hz', value=30)]))
    assert is_float(node, 30.0)
    assert node.bring_up()
    # The new value of ``rate_hz`` equals the present one.
    both = [Parameter('rate_hz', value=30), Parameter('gain', value=3)]
    assert node.set_parameters_atomically(both).successful
    assert node.get_parameter('gain').value == 3.0


@pytest.mark.parametrize('option', ['-p', '--params-file'])
def test_the_command_line_gives_an_integer_for_a_float(context, parameter_file, option):
    path = parameter_file('recording: {ros__parameters: {rate_hz: 50}}')
    value = 'rate_hz:=50' if option == '-p' else str(path)
    node = RecordingNode(context=context, cli_args=['--ros-args', option, value])
    assert is_float(node, 50.0)
    node.destroy_node()


def test_another_process_sets_an_integer_for_a_float(context, make_node, spun):
    node, other = make_node(), Node('other', context=context)
    client = other.create_client(SetParameters, '/recording/set_parameters')

    def set_to(name, value):
        message = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[message])
        (result,) = send(other, lambda: client.call_async(request)).result(20.0).results
        return result.reason

    spun(other)
    spun(node)
    assert client.wait_for_service(timeout_sec=20.0)
    assert not set_to('rate_hz', 40)
    assert is_float(node, 40.0)
    assert 'out of range' in set_to('rate_hz', 101)
    for name, wrong in (('rate_hz', True), ('rate_hz', '40'), ('rate_hz', [40]), ('count', 4.0)):
        assert 'Wrong parameter type' in set_to(name, wrong)
    assert is_float(node, 40.0)


def test_value_that_is_no_choice_refuses_configure_and_cannot_be_set_later(make_node):
    node = make_node(unit='lb')
    assert not node.bring_up()
    assert node.calls == ['tear_down']
    assert node.set_parameters([Parameter('unit', value='g')])[0].successful
    (result,) = node.set_parameters([Parameter('unit', value='lb')])
    assert not result.successful
    assert 'kg, g' in result.reason


def test_parameters_do_not_change_from_configure_to_cleanup_but_for_live_ones(make_node):
    node = make_node()

    def set_to(name, value):
        (result,) = node.set_parameters([Parameter(name, value=value)])
        return result.reason if not result.successful else 'set'

    assert set_to('count', 4) == 'set'
    for transition in (node.trigger_configure, node.trigger_activate, node.trigger_deactivate):
        transition()
        refusal = set_to('count', 5)
        assert 'count is read when the node is configured' in refusal
        assert 'deactivate and clean up the node first' in refusal
        assert set_to('count', 4) == 'set'  # equals the present value
        assert set_to('gain', float(node.calls.count('start') + 2)) == 'set'
    node.trigger_cleanup()
    assert set_to('count', 5) == 'set'
    assert node.bring_up()
    assert node.config.count == 5
    assert 'read' in node.describe_parameter('count').additional_constraints
    assert not node.describe_parameter('gain').additional_constraints


def test_parameters_can_be_mended_after_a_configuration_that_failed(make_node):
    node = make_node(path='nowhere', autostart=False)
    assert not node.bring_up()
    assert node.set_parameters([Parameter('path', value='here')])[0].successful
    assert node.bring_up()
    # The parameter ``autostart`` is read-only.
    assert not node.set_parameters([Parameter('autostart', value=True)])[0].successful


def test_bring_up_and_take_down_in_order(make_node):
    node = make_node()
    assert node.bring_up()
    assert node.is_active
    node.trigger_deactivate()
    node.trigger_cleanup()
    assert node.calls == ['set_up', 'start', 'stop', 'tear_down']
    assert not node.is_active


@pytest.mark.parametrize(
    ('failure', 'calls'),
    [('set_up', ['set_up', 'tear_down']), ('start', ['set_up', 'start'])],
)
def test_what_fails_gives_back_what_it_took_and_can_be_tried_again(make_node, failure, calls):
    node = make_node()
    node.failure = failure
    assert not node.bring_up()
    assert not node.is_active
    assert node.calls == calls
    node.failure = ''
    assert failure == 'start' or node.bring_up()


def test_a_node_that_was_taken_down_is_not_in_the_graph(context):
    peer = Node('peer', context=context)
    # Nodes of other tests may still be in the graph, so this node has a separate namespace.
    node = RecordingNode(context=context, namespace='taken_down')
    name = ('recording', '/taken_down')
    wait_until(lambda: name in peer.get_node_names_and_namespaces())
    node.take_down()
    wait_until(lambda: name not in peer.get_node_names_and_namespaces())
    assert node.calls == ['tear_down']
    peer.destroy_node()


def test_the_next_node_of_a_name_has_the_default_log_level(make_node):
    default = make_node().get_logger().get_effective_level()
    quiet = make_node()
    quiet.get_logger().set_level(LoggingSeverity.WARN)
    quiet.take_down()
    assert make_node().get_logger().get_effective_level() == default
