# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every topic and field in a layout is published and recorded by our nodes."""

import json
from pathlib import Path
import re
import xml.etree.ElementTree as ElementTree

import pytest

from linear_guide_driver.config import LinearGuideConfig, TendonActuatorConfig
from tactile_bags.message_types import message_store
from tactile_ros.topics import FINGER_TOPICS

FOLDER = Path(__file__).resolve().parents[3] / 'tactile_bringup' / 'layouts'
JOINT_STATE = 'sensor_msgs/msg/JointState'
TOPICS = {f'/{topic.name}': topic.type_name for topic in FINGER_TOPICS}
JOINTS = {
    '/linear_guide/joint_states': LinearGuideConfig().joint_name,
    '/tendon_actuator/joint_states': TendonActuatorConfig().joint_name,
}


@pytest.fixture(scope='module')
def store():
    return message_store()


def check_field(store, topic, steps):
    """Check that a path of field names exists in the messages of a topic; return its type."""
    assert topic in TOPICS, f'no node publishes {topic}'
    type_name = TOPICS[topic]
    for step in steps:
        name, _, index = step.partition('[')
        fields = dict(store.get_msgdef(type_name).fields)
        assert name in fields, f'{type_name} has no field {name}'
        kind, detail = fields[name]
        is_array = int(kind) in (3, 4)
        assert is_array == bool(index), f'{name} of {type_name}: an array, or not'
        if is_array:
            kind, detail = detail[0]
        type_name = detail if int(kind) == 2 else ''
    assert not steps or not type_name, f'{steps} is a message, not a value'
    return detail[0] if steps else type_name


def check_numeric(store, topic, steps):
    kind = check_field(store, topic, steps)
    assert re.fullmatch(r'float(32|64)|u?int(8|16|32|64)|bool', kind), f'{steps} is a {kind}'


@pytest.fixture(scope='module')
def foxglove():
    return json.loads((FOLDER / 'foxglove.json').read_text())


@pytest.fixture(scope='module')
def plotjuggler():
    return ElementTree.parse(FOLDER / 'plotjuggler.xml').getroot()


def panels_of(layout):
    if isinstance(layout, str):
        return [layout]
    return panels_of(layout['first']) + panels_of(layout['second'])


def test_foxglove_layout_shows_existing_fields(store, foxglove):
    assert sorted(panels_of(foxglove['layout'])) == sorted(foxglove['configById'])
    for name, panel in foxglove['configById'].items():
        kind = name.partition('!')[0]
        paths = [(path['value'], path['timestampMethod']) for path in panel.get('paths', [])]
        if 'topicPath' in panel:
            paths.append((panel['topicPath'], 'receiveTime'))
        for path, time in paths:
            topic, *steps = re.sub(r'\{.*?\}', '', path).split('.')
            for field in re.findall(r"\{(\w+)=='\w+'\}", path):
                assert check_field(store, topic, [field]) == 'string'
            if kind == 'Plot':
                check_numeric(store, topic, steps)
            else:
                assert bool(steps) == (kind == 'StateTransitions')
                check_field(store, topic, steps)
            if time == 'headerStamp':
                check_numeric(store, topic, ['header', 'stamp', 'sec'])


def test_plotjuggler_layout_shows_and_subscribes_to_existing_fields(store, plotjuggler):
    shown = set()
    for curve in (each.get('name') for each in plotjuggler.iter('curve')):
        topic = next((t for t in TOPICS if curve.startswith(f'{t}/')), '')
        assert topic, f'no node publishes {curve}'
        steps = curve[len(topic) + 1 :].split('/')
        if TOPICS[topic] == JOINT_STATE:
            assert steps[0] == JOINTS[topic]
            steps = [f'{steps[1]}[0]']
        check_numeric(store, topic, steps)
        check_numeric(store, topic, ['header', 'stamp', 'sec'])  # the time axis in PlotJuggler
        shown.add(topic)
    (plugin,) = plotjuggler.iter('plugin')
    (streamer,) = plotjuggler.iter('previouslyLoaded_Streamer')
    assert plugin.get('ID') == streamer.get('name') == 'ROS2 Topic Subscriber'
    chosen = {setting.tag: setting.get('value') for setting in plugin}
    assert chosen['use_header_stamp'] == 'true'
    assert set(chosen['selected_topics'].split(';')) == shown


def test_plotjuggler_layout_has_consistent_areas_and_plots(plotjuggler):
    tabs = plotjuggler.findall('tabbed_widget/Tab')
    assert tabs
    for tab in tabs:
        assert int(tab.get('containers')) == len(tab.findall('Container/DockSplitter'))
    for splitter in plotjuggler.iter('DockSplitter'):
        sizes = splitter.get('sizes').split(';')
        assert len(splitter) == int(splitter.get('count')) == len(sizes)
    assert all(area.findall('plot/curve') for area in plotjuggler.iter('DockArea'))
