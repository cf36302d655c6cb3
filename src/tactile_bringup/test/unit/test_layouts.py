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

"""Every topic and field that a layout shows is one that our nodes publish."""

import json
from pathlib import Path
import re
import xml.etree.ElementTree as ElementTree

import pytest

from linear_guide_driver.records import LinearGuideConfig, TendonActuatorConfig
from tactile_bags import (
    DIAGNOSTICS,
    message_store,
    recorded_topics,
    RecordedTopic,
)
from tactile_classifier.names import all_classifier_names

FOLDER = Path(__file__).resolve().parents[2] / 'layouts'
JOINT_STATE = 'sensor_msgs/msg/JointState'
TOPICS = {
    f'/{topic.name}': topic.type_name
    for topic in (*recorded_topics(all_classifier_names()), RecordedTopic('x', DIAGNOSTICS))
}
TOPICS['/diagnostics'] = TOPICS.pop('/x')
JOINTS = {
    '/linear_guide/joint_states': LinearGuideConfig().joint_name,
    '/tendon_actuator/joint_states': TendonActuatorConfig().joint_name,
}


@pytest.fixture(scope='module')
def store():
    return message_store()


def check_field(store, topic, steps):
    """Follow a path of field names, such as wrench, force, x or values[0]."""
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
    for panel in foxglove()['configById'].values():
        for path in panel.get('paths', []):
            yield path['value']
        for key in ('topicPath', 'topicToRender'):
            if key in panel:
                yield panel[key]


@pytest.mark.parametrize('path', foxglove_paths())
def test_foxglove_shows_fields_that_there_are(store, path):
    topic, *steps = path.split('.')
    check_field(store, topic, steps)


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
    check_field(store, topic, steps)


def test_plotjuggler_subscribes_to_what_it_shows():
    (chosen,) = plotjuggler().iter('selected_topics')
    topics = chosen.get('value').split(';')
    assert all(any(curve.startswith(f'{topic}/') for topic in topics) for curve in curves())
    assert all(topic in TOPICS for topic in topics)
    for splitter in plotjuggler().iter('DockSplitter'):
        assert len(splitter) == int(splitter.get('count'))
        assert len(re.findall('[^;]+', splitter.get('sizes'))) == len(splitter)
