# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every topic and field that a layout shows is one that our nodes publish and record."""

import json
from pathlib import Path
import re
import xml.etree.ElementTree as ElementTree

import pytest

from linear_guide_driver.records import LinearGuideConfig, TendonActuatorConfig
from tactile_bags.recorded_topics import FINGER_TOPICS, message_store

FOLDER = Path(__file__).resolve().parents[2] / 'layouts'
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
    """Follow a path of field names, such as wrench, force, x or values[0]; return its type."""
    assert topic in TOPICS, f'nobody publishes {topic}'
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


def foxglove():
    return json.loads((FOLDER / 'foxglove.json').read_text())


def plotjuggler():
    return ElementTree.parse(FOLDER / 'plotjuggler.xml').getroot()


def panels_of(layout):
    if isinstance(layout, str):
        return [layout]
    assert layout['direction'] in ('row', 'column')
    assert 0 < layout['splitPercentage'] < 100
    return panels_of(layout['first']) + panels_of(layout['second'])


def test_foxglove_places_every_panel_once():
    document = foxglove()
    assert sorted(panels_of(document['layout'])) == sorted(document['configById'])
    assert {'globalVariables', 'userNodes', 'playbackConfig'} <= set(document)


def foxglove_paths():
    for name, panel in foxglove()['configById'].items():
        for path in panel.get('paths', []):
            yield name.partition('!')[0], path['value'], path['timestampMethod']
        if 'topicPath' in panel:
            yield name.partition('!')[0], panel['topicPath'], 'receiveTime'


@pytest.mark.parametrize(('kind', 'path', 'time'), foxglove_paths())
def test_foxglove_shows_fields_that_there_are(store, kind, path, time):
    filters = re.findall(r"\{(\w+)=='\w+'\}", path)
    topic, *steps = re.sub(r'\{.*?\}', '', path).split('.')
    for field in filters:
        assert check_field(store, topic, [field]) == 'string'
    if kind == 'Plot':
        check_numeric(store, topic, steps)
    else:
        assert bool(steps) == (kind == 'StateTransitions')
        check_field(store, topic, steps)
    if time == 'headerStamp':
        check_numeric(store, topic, ['header', 'stamp', 'sec'])


def curves():
    return [curve.get('name') for curve in plotjuggler().iter('curve')]


@pytest.mark.parametrize('curve', curves())
def test_plotjuggler_shows_fields_that_there_are(store, curve):
    topic = next((t for t in TOPICS if curve.startswith(f'{t}/')), '')
    assert topic, f'nobody publishes {curve}'
    steps = curve[len(topic) + 1 :].split('/')
    if TOPICS[topic] == JOINT_STATE:  # shown by the name of the joint
        assert steps[0] == JOINTS[topic]
        steps = [f'{steps[1]}[0]']
    check_numeric(store, topic, steps)
    check_numeric(store, topic, ['header', 'stamp', 'sec'])  # by which it is drawn


def test_plotjuggler_subscribes_to_what_it_shows():
    (plugin,) = plotjuggler().iter('plugin')
    (streamer,) = plotjuggler().iter('previouslyLoaded_Streamer')
    assert plugin.get('ID') == streamer.get('name') == 'ROS2 Topic Subscriber'
    chosen = {setting.tag: setting.get('value') for setting in plugin}
    assert chosen['use_header_stamp'] == 'true'
    topics = chosen['selected_topics'].split(';')
    assert all(topic in TOPICS for topic in topics)
    assert {next(t for t in topics if c.startswith(f'{t}/')) for c in curves()} == set(topics)


def test_plotjuggler_finds_its_areas_and_plots():
    tabs = plotjuggler().findall('tabbed_widget/Tab')
    assert tabs
    for tab in tabs:
        assert int(tab.get('containers')) == len(tab.findall('Container/DockSplitter'))
    for splitter in plotjuggler().iter('DockSplitter'):
        assert {child.tag for child in splitter} <= {'DockArea', 'DockSplitter'}
        sizes = [float(size) for size in splitter.get('sizes').split(';')]
        assert len(splitter) == int(splitter.get('count')) == len(sizes)
        assert sum(sizes) == pytest.approx(1.0, abs=1e-5)
    for area in plotjuggler().iter('DockArea'):
        (plot,) = area.findall('plot')
        assert plot.findall('curve')
