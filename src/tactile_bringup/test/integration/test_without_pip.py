# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The packages of a robot can be imported if only packages from apt are installed."""

from importlib.util import find_spec
from pathlib import Path
import subprocess
import sys

import pytest

LAUNCH_FILES = sorted((Path(__file__).resolve().parents[2] / 'launch').glob('*.launch.py'))
ROBOT = (
    'tactile_ros',
    'tendon_sensor_driver',
    'linear_guide_driver',
    'tactile_features',
    'tactile_classifier',
    'tactile_bringup',
)
ONLY_PIP = ('lz4', 'mcap', 'pyarrow', 'rosbags', 'zstandard')
OTHERS = ('numba', 'tactile_bags', 'tactile_lab', 'tactile_sim')
"""Packages that are optional on a robot."""

HAS_LAUNCH = bool(find_spec('launch.actions') if find_spec('launch') else None)

BLOCK = """
import sys
for name in {blocked!r}:
    sys.modules[name] = None  # importing it raises ModuleNotFoundError
"""
LEFT_OUT = ('.compiled_convolutions',) if HAS_LAUNCH else ('.compiled_convolutions', '.launching')
"""Modules that can be imported only if numba or launch is installed."""

IMPORT_ALL = """
import importlib, pkgutil
for name in {packages!r}:
    package = importlib.import_module(name)
    for module in pkgutil.walk_packages(package.__path__, name + '.'):
        if not module.name.endswith({left_out!r}):
            print(importlib.import_module(module.name).__name__)
"""
RUN_FILE = """
import runpy
assert runpy.run_path({path!r})['generate_launch_description']()
"""


def run(code, blocked=ONLY_PIP + OTHERS):
    """Run Python code in a new process that cannot import some modules; return its output."""
    command = [sys.executable, '-c', BLOCK.format(blocked=blocked) + code]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_every_module_is_imported():
    imported = run(IMPORT_ALL.format(packages=ROBOT, left_out=LEFT_OUT))
    assert 'tactile_bringup.nodes.finger_node' in imported
    assert 'tactile_bringup.nodes.trial_runner_node' in imported
    assert {name.partition('.')[0] for name in imported} == set(ROBOT)


@pytest.mark.skipif(not HAS_LAUNCH, reason='launch is not installed')
@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda path: path.name)
def test_a_launch_file_shows_its_arguments(path):
    run(RUN_FILE.format(path=str(path)))


def refused(call, blocked):
    """Return the message with which a call is refused if some modules are not installed."""
    code = f"""
import runpy
from tactile_bringup.launch_config import graph
from tactile_ros.errors import TactileError
try:
    {call}
except TactileError as error:
    print(error)
"""
    (sentence,) = run(code, blocked)
    return sentence


@pytest.mark.skipif(not HAS_LAUNCH, reason='launch is not installed')
def test_a_replay_says_what_to_install():
    replay = str(LAUNCH_FILES[0].with_name('replay.launch.py'))
    sentence = refused(f"runpy.run_path({replay!r})['launch_setup'](None)", ('tactile_bags',))
    assert sentence.startswith('a replay needs tactile_bags, which is not installed: build')


@pytest.mark.parametrize(
    ('blocked', 'call', 'sentence'),
    [
        (
            ('tactile_bags', 'mcap'),
            "graph.recorder_parameters('bag')",
            'a recording needs tactile_bags and mcap, which are not installed: build tactile_bags '
            'in this workspace, and run: pip install mcap rosbags',
        ),
        (
            ('tactile_sim',),
            "graph.require_package('tactile_sim', 'rig:=simulated')",
            'rig:=simulated needs tactile_sim, which is not installed: build tactile_sim in this '
            'workspace',
        ),
    ],
)
def test_what_is_asked_for_and_not_installed_is_named(blocked, call, sentence):
    assert refused(call, blocked) == sentence
