# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Functions that run the `tactile` command in the process of the test or in a separate process."""

from contextlib import contextmanager, redirect_stderr, redirect_stdout
import io
import json
import subprocess
import sys
from types import SimpleNamespace

import pytest
from typer.main import get_command

from tactile_sim.rig_process import SimulatedRig

QUICK = 'trial_runner:\n  ros__parameters:\n    approach_speed_m_s: 0.1\n'
"""A parameter file for short trials. The finger approaches the object quickly."""

SHORT_HOLD = QUICK + '    hold_s: 2.8\n'
"""A parameter file for trials with a short hold phase, which barely contains the window of the
stiffness features. Models need trials with the usual hold phase."""


def tactile(*arguments):
    """Run the command; return exit code, stdout and stderr, as `subprocess.run` does."""
    from tactile_lab.program import app

    # Click's CliRunner is not used, because in old versions it mixes stdout and stderr.
    stdout, stderr = io.StringIO(), io.StringIO()
    with redirect_stdout(stdout), redirect_stderr(stderr), pytest.raises(SystemExit) as ended:
        get_command(app).main([*map(str, arguments)], prog_name='tactile')
    return SimpleNamespace(
        returncode=ended.value.code or 0, stdout=stdout.getvalue(), stderr=stderr.getvalue()
    )


def answer_of(*arguments):
    """Run the command with ``--json``; return its exit code and the parsed standard output."""
    done = tactile(*arguments, '--json')
    return done.returncode, json.loads(done.stdout)


def ask_tactile(*arguments):
    """Run the command with ``--json``, which must succeed; return the parsed standard output."""
    return ask_and_hear_tactile(*arguments)[0]


def ask_and_hear_tactile(*arguments):
    """Run the command with ``--json``; return the parsed standard output and standard error."""
    done = tactile(*arguments, '--json')
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), ' '.join(done.stderr.split())


def hear_tactile(*arguments, code=0):
    """Run the command, which must exit with ``code``; return its output as one line."""
    done = tactile(*arguments)
    said = ' '.join(f'{done.stdout} {done.stderr}'.split())
    assert done.returncode == code, said
    return said


def let_rigs_home_fast(set_attribute):
    """Shorten the homing of all rigs started later. ``set_attribute`` is monkeypatch.setattr."""
    from tactile_testing.simulated_rigs import (
        home_fast,  # imported here, because tests of the wheel do not have this package
    )

    start = SimulatedRig.__init__

    def start_and_hasten(rig, *arguments, **options):
        start(rig, *arguments, **options)
        home_fast(rig)

    set_attribute(SimulatedRig, '__init__', start_and_hasten)


@contextmanager
def program(*arguments):
    """Run the command with fast homing in a separate process, which is killed after the block."""
    process = subprocess.Popen(
        [sys.executable, __file__, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


if __name__ == '__main__':
    from tactile_lab.__main__ import main

    let_rigs_home_fast(setattr)
    sys.argv[0] = 'tactile'
    raise SystemExit(main())
