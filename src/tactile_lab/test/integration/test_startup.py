# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Imports and words of the command line before it works."""

import json
from pathlib import Path
import re
import shutil
import subprocess
import sys

import pytest

from tactile_lab.program import COMMANDS

ROOT = Path(__file__).resolve().parents[4]
needs_repository = pytest.mark.skipif(
    not (ROOT / 'tools').is_dir(), reason='the packages are not in their own repository'
)
HEAVY = {
    'joblib', 'matplotlib', 'numba', 'numpy', 'onnxruntime', 'rclpy', 'rosbags', 'scipy', 'serial',
    'sklearn', 'tactile_msgs', 'yaml',
}  # fmt: skip
OF_OTHER_WORK = {
    'aiohttp', 'asyncio', 'joblib', 'matplotlib', 'numba', 'pandas', 'pyarrow', 'rosbags', 'scipy',
    'sklearn', 'skl2onnx', 'sqlite3', 'unittest',
}  # fmt: skip
PROGRAM = """
import json, sys
from tactile_lab.__main__ import main
try:
    main()
except SystemExit as end:
    print(json.dumps([end.code, sorted(sys.modules)]), file=sys.stderr)
"""


def run(arguments):
    """Run the command in a Python of its own; return exit code, standard output and modules."""
    command = [sys.executable, '-c', PROGRAM, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    code, modules = json.loads(done.stderr.splitlines()[-1])
    return (
        code,
        done.stdout + done.stderr,
        {name.partition('.')[0] for name in modules} | set(modules),
    )


@pytest.mark.parametrize(
    ('arguments', 'code'),
    [
        (['--version'], 0),
        *(([name, '--help'], 0) for name in COMMANDS),
        (['sense', '--bogus'], 2),
        (['train', 'nowhere', '-o', 'models'], 2),
        (['evaluate', 'nowhere.npz'], 2),
        (['replay', 'nowhere'], 2),
        (['repair', 'nowhere', '-o', 'copy'], 2),
        (['sense', '--simulated', '--models', 'nowhere'], 2),
        (['hand', '--params', 'nowhere'], 2),
        (['rig', '--simulated', '--models', 'nowhere'], 2),
    ],
)
def test_help_and_wrong_paths_import_nothing_slow(arguments, code):
    ended, said, modules = run(arguments)
    assert ended == code
    assert not modules & HEAVY
    if 'nowhere' in ' '.join(arguments):
        assert re.search(r'nowhere\S* does not exist', said)


def test_help_imports_no_command():
    code, said, modules = run(['--help'])
    assert (code, 'Cross-validate' in said) == (0, True)
    assert not modules & HEAVY
    assert not [name for name in modules if name.startswith(('tactile_lab.c', 'tactile_lab.o'))]


def test_a_folder_without_models_is_refused_before_ros_is_loaded(tmp_path):
    code, said, modules = run(['sense', '--simulated', '--models', str(tmp_path)])
    assert code == 2
    assert 'no model files' in said
    assert not modules & {'rclpy', 'onnxruntime', 'sklearn', 'matplotlib'}


def test_a_process_that_senses_loads_no_library_of_other_work():
    """Each finger may have a process of its own, on a small computer."""
    program = (
        'import json, sys\n'
        'import tactile_bringup.nodes.graph_runner, tactile_lab.watch.watching\n'
        'import tactile_lab.program, tactile_lab.running, onnxruntime\n'
        'from tactile_ros.node_program import find_node_class\n'
        "for name in 'tendon_sensor tactile_features slip_detector tactile_classifier'.split():\n"
        "    find_node_class(name + '_node')\n"
        'print(json.dumps(sorted(sys.modules)))\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', program], capture_output=True, text=True, timeout=60, check=True
    )
    modules = {name.partition('.')[0] for name in json.loads(done.stdout)}
    assert {'rclpy', 'onnxruntime', 'numpy'} <= modules
    assert not modules & OF_OTHER_WORK


@needs_repository
def test_the_version_is_that_of_the_package():
    manifest = (ROOT / 'src' / 'tactile_lab' / 'package.xml').read_text()
    version = re.search('<version>(.*?)</version>', manifest)[1]
    assert run(['--version'])[1].splitlines()[0] == f'tactile {version}'


@needs_repository
def test_both_helps_name_every_command():
    script = [sys.executable, str(ROOT / 'tools' / 'main.py'), '--help']
    ours = subprocess.run(script, capture_output=True, text=True, check=True).stdout
    theirs = run(['--help'])[1]
    assert len(COMMANDS) >= 13
    for name in COMMANDS:
        assert re.search(rf'(?<![\w-]){name}(?![\w-])', ours), name
        assert re.search(rf'(?<![\w-]){name}(?![\w-])', theirs), name


@needs_repository
def test_a_clone_that_cannot_be_written_is_one_sentence(tmp_path):
    for name in ('tools', 'requirements'):
        shutil.copytree(ROOT / name, tmp_path / name)
    (tmp_path / 'src').mkdir()
    (tmp_path / '.tactile').write_text('a file where the folder must be')
    script = [sys.executable, str(tmp_path / 'tools' / 'main.py'), 'build']
    done = subprocess.run(script, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, '')
    assert re.fullmatch(r'tactile: cannot write into .*\n', done.stderr)
