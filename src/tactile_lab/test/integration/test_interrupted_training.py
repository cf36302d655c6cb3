# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Ctrl-C during the choice of features ends `tactile train` without leaving files."""

import os
from pathlib import Path
import re
import signal
import subprocess
import sys

import numpy as np
import tactile_command


def list_children(pid):
    """Return the child processes of all threads of a process."""
    tasks = Path(f'/proc/{pid}/task').iterdir()
    return [child for task in tasks for child in (task / 'children').read_text().split()]


def test_interrupt_ends_training_without_leaving_files_or_processes(tmp_path):
    path = tmp_path / 'trials.npz'
    label = np.repeat(['fine', 'coarse', 'flat'], 100)
    x = np.random.default_rng(0).normal(size=(300, 1, 200))
    np.savez(path, x=x, label=label, rate_hz=60.0)
    ours, terminal = os.openpty()  # the progress bar is only shown on a terminal
    arguments = ('train', path, '--task', 'texture', '-o', tmp_path / 'models')
    process = subprocess.Popen(
        [sys.executable, tactile_command.__file__, *map(str, arguments)],
        stdout=subprocess.DEVNULL,
        stderr=terminal,
        env={**os.environ, 'TERM': 'xterm', 'COLUMNS': '120', 'LOKY_MAX_CPU_COUNT': '2'},
    )
    os.close(terminal)
    said = ''
    try:
        while not re.search(r'[1-9]\d*/\d+', said):  # wait until some candidates are done
            said += os.read(ours, 4096).decode()
        assert list_children(process.pid) == []
        process.send_signal(signal.SIGINT)
        said = read_all(ours)
        assert process.wait(timeout=60) == 130, said
    finally:
        process.kill()
        process.wait()
        os.close(ours)
    assert 'Traceback' not in said
    assert list(tmp_path.iterdir()) == [path]


def read_all(terminal):
    """Return all text until the program ends."""
    said = b''
    try:
        while part := os.read(terminal, 4096):
            said += part
    except OSError:  # Linux reports the end of a pseudo-terminal as an error
        pass
    return said.decode()
