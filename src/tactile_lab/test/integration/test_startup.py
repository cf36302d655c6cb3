# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Start of the command line: imports, help, version and refusals."""

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
    'joblib', 'matplotlib', 'numba', 'numpy', 'rclpy', 'rosbags', 'scipy', 'serial', 'sklearn',
    'tactile_msgs', 'yaml',
}  # fmt: skip
OF_OTHER_WORK = {
    'aiohttp', 'asyncio', 'joblib', 'matplotlib', 'numba', 'pandas', 'pyarrow', 'rosbags', 'scipy',
    'sklearn', 'sqlite3', 'unittest',
}  # fmt: skip
PROGRAM = """
from contextlib import redirect_stderr, redirect_stdout
import io, json, sys
import tactile_lab.__main__
from tactile_lab import program
found = []
for sys.argv in json.loads(sys.argv[1]):
    with redirect_stdout(io.StringIO()) as said, redirect_stderr(said):
        try:
            code = program.main()
        except SystemExit as end:
            code = end.code
    found.append([code, said.getvalue(), sorted(sys.modules)])
print(json.dumps(found))
"""


def run(*commands):
    """Run commands one after the other in a separate Python process.

    Yield for each its exit code, its output, and all modules that are loaded after it.
    """
    arguments = [['tactile', *command] for command in commands]
    command = [sys.executable, '-c', PROGRAM, json.dumps(arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    for code, said, modules in json.loads(done.stdout):
        yield code, said, {name.partition('.')[0] for name in modules} | set(modules)


def test_help_and_wrong_paths_import_no_slow_module():
    refused = (
        ['sense', '--bogus'],
        ['train', 'nowhere', '-o', 'models'],
        ['evaluate', 'nowhere.npz'],
        ['evaluate', 'nowhere.npz', 'b.npz', '--task', 'texture'],
        ['replay', 'nowhere'],
        ['repair', 'nowhere', '-o', 'copy'],
        ['sense', '--simulated', '--models', 'nowhere'],
        ['hand', '--params', 'nowhere'],
        ['rig', '--simulated', '--params', 'nowhere.yaml'],
        ['rig', '--simulated', '--models', 'nowhere'],
    )
    named = [[name] for name in COMMANDS] + [['experiment', name] for name in ('new', 'status')]
    helps = [[*names, '--help'] for names in named]
    commands = [['--version'], *helps, *refused]
    for command, (code, said, modules) in zip(commands, run(*commands), strict=True):
        assert code == (2 if command in refused else 0), command
        assert command not in helps or len(said.splitlines()) > 10, command
        assert not modules & HEAVY, command
        if 'nowhere' in ' '.join(command):
            assert re.search(r'nowhere\S* does not exist', ' '.join(said.split()))


def test_help_lists_all_commands_without_importing_them():
    ((code, said, modules),) = run(['--help'])
    assert (code, 'model files' in said) == (0, True)
    assert not modules & HEAVY
    assert not [name for name in modules if name.startswith(('tactile_lab.c', 'tactile_lab.o'))]
    for name in COMMANDS:
        assert re.search(rf'(?<![\w-]){name}(?![\w-])', said), name


def test_a_folder_without_models_is_refused_before_ros_is_loaded(tmp_path):
    ((code, said, modules),) = run(['sense', '--simulated', '--models', str(tmp_path)])
    assert code == 2
    assert 'no model files' in said
    assert not modules & {'rclpy', 'sklearn', 'matplotlib'}


def test_sensing_process_loads_no_unneeded_library():
    """A small computer may run a separate process for each finger, so memory matters."""
    program = (
        'import json, sys\n'
        'import tactile_bringup.nodes.graph_runner, tactile_lab.watch.watching\n'
        'import tactile_lab.program, tactile_lab.running\n'
        'from tactile_ros.node_program import find_node_class\n'
        "for name in 'tendon_sensor tactile_features tactile_classifier'.split():\n"
        "    find_node_class(name + '_node')\n"
        'print(json.dumps(sorted(sys.modules)))\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', program], capture_output=True, text=True, timeout=60, check=True
    )
    modules = {name.partition('.')[0] for name in json.loads(done.stdout)}
    assert {'rclpy', 'numpy'} <= modules
    assert not modules & OF_OTHER_WORK


@needs_repository
def test_version_option_prints_the_version_of_the_package():
    manifest = (ROOT / 'src' / 'tactile_lab' / 'package.xml').read_text()
    version = re.search('<version>(.*?)</version>', manifest)[1]
    ((_, said, _),) = run(['--version'])
    assert said.strip() == f'tactile {version}'


@needs_repository
def test_help_of_the_tactile_script_lists_every_command():
    script = [sys.executable, str(ROOT / 'tools' / 'main.py'), '--help']
    said = subprocess.run(script, capture_output=True, text=True, check=True).stdout
    for name in COMMANDS:
        assert re.search(rf'(?<![\w-]){name}(?![\w-])', said), name


@needs_repository
def test_read_only_clone_is_refused_in_one_sentence(tmp_path):
    for name in ('tools', 'requirements'):
        shutil.copytree(ROOT / name, tmp_path / name)
    (tmp_path / 'src').mkdir()
    (tmp_path / '.tactile').write_text('a file where the folder must be')
    script = [sys.executable, str(tmp_path / 'tools' / 'main.py'), 'build']
    done = subprocess.run(script, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, '')
    assert re.fullmatch(r'tactile: cannot write to .*\n', done.stderr)
