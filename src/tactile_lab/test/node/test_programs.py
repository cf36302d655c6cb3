# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Start and end of node executables and of the `tactile` command."""

import ctypes
import itertools
import os
from pathlib import Path
import signal
import subprocess
import sys

from ament_index_python.packages import get_package_prefix
import pytest

from tactile_ros.node_program import find_node_class
from tactile_testing.waiting import wait_until

DEADLINE_S = 60.0
HEAP_BYTES = 64 * 2**20
TACTILE = str(Path(get_package_prefix('tactile_lab'), 'bin', 'tactile'))


def program_of(executable):
    package = find_node_class(executable).__module__.partition('.')[0]
    return str(Path(get_package_prefix(package), 'lib', package, executable))


def start(*arguments):
    return subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd='/'
    )


def wait_until_held(process):
    """Wait until the process handles SIGTERM, which is long before its node is created."""

    def is_held():
        assert process.poll() is None, process.stderr.read()
        status = Path(f'/proc/{process.pid}/status').read_text()
        caught = int(dict(row.split(':', 1) for row in status.splitlines())['SigCgt'], 16)
        return caught >> (signal.SIGTERM - 1) & 1

    wait_until(is_held, timeout_s=DEADLINE_S, poll_s=0.0)


FINGERS = str(Path(get_package_prefix('tactile_bringup'), 'lib', 'tactile_bringup', 'finger_node'))
PROGRAMS = {
    'tendon_sensor_node': (program_of('tendon_sensor_node'),),
    'tactile_features_node': (program_of('tactile_features_node'),),
    'finger_node': (FINGERS, '/tendon_sensor', '/tactile_features'),
    'rig': (TACTILE, 'rig', '--simulated'),
    'hand': (TACTILE, 'hand', '--fingers', 'index', '--simulated'),
}
"""Executables of one node or several nodes, and commands that run nodes."""


@pytest.mark.parametrize(
    ('name', 'number'),
    zip(PROGRAMS, itertools.cycle([signal.SIGINT, signal.SIGTERM, signal.SIGHUP]), strict=False),
)
def test_signal_before_nodes_are_created_ends_a_program_with_0(name, number):
    process = start(*PROGRAMS[name])
    wait_until_held(process)
    process.send_signal(number)
    output, errors = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, output, errors) == (0, '', '')


def test_working_command_is_terminated_with_its_exit_code(tmp_path):
    process = start(TACTILE, 'demo', '--short', '-o', str(tmp_path / 'demo'))
    assert process.stdout.readline()
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 128 + signal.SIGTERM, errors
    assert 'Traceback' not in errors


def count_thread_heaps(pid):
    """Return the number of heaps that glibc has created for threads.

    Such a heap is a writable area at a multiple of 64 MB, followed by a reserved area."""
    rows = [row.split() for row in Path(f'/proc/{pid}/maps').read_text().splitlines()]
    ranges = [tuple(int(end, 16) for end in row[0].split('-')) for row in rows]
    return sum(
        begin % HEAP_BYTES == 0
        and row[1].startswith('rw')
        and following[1].startswith('---')
        and next_end == begin + HEAP_BYTES
        for (begin, _), row, (_, next_end), following in zip(
            ranges, rows, ranges[1:], rows[1:], strict=False
        )
    )


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), 'malloc_info'), reason='needs glibc')
@pytest.mark.parametrize(
    'arguments',
    [PROGRAMS['tactile_features_node'], (TACTILE, 'sense', '--simulated')],
    ids=['node', 'sense'],
)
def test_all_threads_of_a_program_share_one_heap(arguments):
    process = start(*arguments)
    wait_until(lambda: len(os.listdir(f'/proc/{process.pid}/task')) > 8, timeout_s=DEADLINE_S)
    heaps = count_thread_heaps(process.pid)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, heaps) == (0, 0), errors


def test_an_executable_without_a_node_is_refused():
    done = subprocess.run(
        [sys.executable, '-c', 'from tactile_ros.node_program import main; main()'],
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
    )
    assert 'no installed package has a node' in done.stderr


def test_setup_script_of_colcon_puts_the_command_on_the_path():
    prefix = get_package_prefix('tactile_lab')
    hook = Path(prefix, 'share', 'tactile_lab', 'package.sh')
    if not hook.exists():
        pytest.skip('these packages were not built by colcon')
    done = subprocess.run(
        ['/bin/sh', '-c', f'. "{hook}"; command -v tactile'],
        env={'PATH': '/usr/bin:/bin', 'COLCON_CURRENT_PREFIX': prefix},
        capture_output=True,
        text=True,
    )
    assert done.stdout.strip() == TACTILE
