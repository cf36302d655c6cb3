# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The macro for a hand's description, with the real xacro, and the layout for RViz."""

from pathlib import Path
import xml.etree.ElementTree as ElementTree

import pytest
import yaml

from tendon_sensor_driver.tendon_sensor_node import TendonSensorConfig

HERE = Path(__file__).resolve().parents[2]
FOLDER = HERE / 'urdf'
MACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'


@pytest.fixture
def expand():
    xacro = pytest.importorskip('xacro', reason='xacro is not installed')

    def expand(path):
        return ElementTree.fromstring(xacro.process_file(str(path)).toxml())

    return expand


def test_the_example_puts_a_sensor_of_each_finger_on_the_palm(expand):
    robot = expand(FOLDER / 'example_hand.urdf.xacro')
    assert [link.get('name') for link in robot.iter('link')] == [
        'palm',
        'index_tendon_sensor',
        'middle_tendon_sensor',
    ]
    for joint in robot.iter('joint'):
        assert joint.get('type') == 'fixed'
        assert joint.find('parent').get('link') == 'palm'
        assert joint.find('child').get('link') in joint.get('name')
        # The frame is rotated by half a turn, so that +x points away from the fingertips.
        assert float(joint.find('origin').get('rpy').split()[2]) == pytest.approx(3.14159265)


def test_the_link_is_by_default_the_frame_of_the_nodes(expand, tmp_path):
    own = tmp_path / 'own.xacro'
    own.write_text(
        f'<robot name="own" {MACRO}><link name="palm"/>'
        f'<xacro:include filename="{FOLDER}/tendon_sensor.urdf.xacro"/>'
        '<xacro:tendon_sensor parent="palm"><origin xyz="0 0 0"/></xacro:tendon_sensor></robot>'
    )
    child = expand(own).find('joint/child')
    assert child.get('link') == TendonSensorConfig().frame_id


def test_rviz_shows_the_tension_at_the_palm():
    layout = yaml.safe_load((HERE / 'layouts' / 'wrench.rviz').read_text())
    layout = layout['Visualization Manager']
    (wrench,) = (d for d in layout['Displays'] if d['Class'].endswith('/Wrench'))
    assert wrench['Topic']['Value'] == '/tendon_sensor/wrench'
    assert layout['Global Options']['Fixed Frame'] == 'palm'
