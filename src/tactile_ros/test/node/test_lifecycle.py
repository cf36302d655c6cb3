# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

from dataclasses import dataclass, field

import pytest
from rclpy.exceptions import InvalidParameterValueException
from rclpy.parameter import Parameter

from tactile_ros.lifecycle import TactileNode
from tactile_ros.parameters import read_config


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


@pytest.mark.parametrize('bad', [{'rate_hz': 0.5}, {'count': 11}])
def test_value_out_of_range_is_refused_at_the_start(make_node, bad):
    with pytest.raises(InvalidParameterValueException, match=next(iter(bad))):
        make_node(**bad)


def test_value_that_is_no_choice_refuses_configure(make_node):
    node = make_node(unit='lb')
    assert not node.bring_up()
    assert node.calls == ['tear_down']


def test_value_that_is_no_choice_cannot_be_set_later(make_node):
    node = make_node()
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
        assert set_to('count', 4) == 'set'  # no change
        assert set_to('gain', float(node.calls.count('start') + 2)) == 'set'
    node.trigger_cleanup()
    assert set_to('count', 5) == 'set'
    assert node.bring_up()
    assert node.config.count == 5
    assert 'read' in node.describe_parameter('count').additional_constraints
    assert not node.describe_parameter('gain').additional_constraints


def test_parameters_can_be_mended_after_a_configuration_that_failed(make_node):
    node = make_node(path='nowhere')
    assert not node.bring_up()
    (result,) = node.set_parameters([Parameter('path', value='here')])
    assert result.successful
    assert node.bring_up()


def test_autostart_is_read_once(make_node):
    node = make_node(autostart=False)
    (result,) = node.set_parameters([Parameter('autostart', value=True)])
    assert not result.successful


def test_config_that_refuses_itself_refuses_configure(make_node):
    assert not make_node(path='nowhere').bring_up()


def test_bring_up_and_take_down_in_order(make_node):
    node = make_node()
    assert node.bring_up()
    assert node.is_active
    node.trigger_deactivate()
    node.trigger_cleanup()
    assert node.calls == ['set_up', 'start', 'stop', 'tear_down']
    assert not node.is_active


def test_failed_set_up_gives_everything_back(make_node):
    node = make_node()
    node.failure = 'set_up'
    assert not node.bring_up()
    assert node.calls == ['set_up', 'tear_down']
    node.failure = ''
    assert node.bring_up()


def test_failed_start_leaves_the_node_inactive(make_node):
    node = make_node()
    node.failure = 'start'
    assert not node.bring_up()
    assert not node.is_active
