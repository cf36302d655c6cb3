# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Ctrl-C during the choice of features ends `tactile train` and leaves nothing behind."""

from pathlib import Path
import signal

import numpy as np
from tactile_command import program

from tactile_testing.waiting import wait_until


def list_threads(pid):
    """Return the names of the threads of a process."""
    return [task.joinpath('comm').read_text() for task in Path(f'/proc/{pid}/task').iterdir()]


def list_children(pid):
    """Return the child processes of all threads of a process."""
    tasks = Path(f'/proc/{pid}/task').iterdir()
    return [child for task in tasks for child in (task / 'children').read_text().split()]


def test_an_interrupt_ends_the_choice_and_leaves_nothing(tmp_path):
    path, models = tmp_path / 'trials.npz', tmp_path / 'models'
    label = np.repeat(['fine', 'coarse', 'flat'], 200)
    x = np.random.default_rng(0).normal(size=(600, 1, 200))
    np.savez(path, x=x, label=label, rate_hz=60.0)
    before = set(tmp_path.iterdir())
    with program('train', path, '--task', 'texture', '-o', models) as process:
        # The workers of the choice are threads; linear algebra starts fewer while importing.
        idle = len(list_threads(process.pid))
        wait_until(lambda: len(list_threads(process.pid)) > idle + 2, timeout_s=120.0)
        assert list_children(process.pid) == []
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert 'Traceback' not in errors
    assert set(tmp_path.iterdir()) == before
