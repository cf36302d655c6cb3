# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Command line of `./tactile`: set up the workspace if necessary, then run the command."""

from __future__ import annotations

import os
import shutil
import sys

from testing import build_site, run_tests
from workspace import ROOT, SetupError, Workspace

DEFAULT_DISTRO = 'jazzy'
OURS = ('build', 'clean', 'docs', 'run', 'shell', 'test')

USAGE = """\
usage: ./tactile COMMAND [ARGUMENT ...]

  demo            all steps on the simulated rig: train, run trials, record, replay
  test [PACKAGE ...] [--unit | --nodes] [-k EXPRESSION] [--workers N]
                  static checks and tests of all packages, or tests of some packages
  run PROGRAM [ARGUMENT ...]
                  any program in the workspace's environment, for example
                  ./tactile run python -m pytest src/tactile_features/test -k spectrum
  shell           a shell in the workspace's environment, in which `tactile` is on the path
  docs            build the documentation site with the API reference
  build           set up and build only
  clean           remove everything in .tactile/

  simulate, import, train, classify, evaluate, features, export, replay, repair, show, trials,
  experiment, rig, sense, hand, event, watch, devices, check, calibrate
                  the commands of `tactile`; ./tactile COMMAND --help explains each

  --version       the version of the packages
  --distro kilted before or after the command selects ROS 2 Kilted instead of Jazzy;
  --distro noble selects Jazzy with the Python libraries of Ubuntu 24.04.

The first call sets up a virtual environment with ROS 2 and builds the workspace
in .tactile/; later calls start immediately.
"""


def take_distro(arguments: list[str]) -> str:
    """Remove ``--distro NAME`` from the arguments and return the name."""
    if '--distro' not in arguments:
        return os.environ.get('TACTILE_DISTRO', DEFAULT_DISTRO)
    at = arguments.index('--distro')
    if at + 1 == len(arguments):
        raise SetupError('--distro needs the name of a ROS 2 distribution.')
    distro = arguments[at + 1]
    del arguments[at : at + 2]
    return distro


def main(arguments: list[str]) -> int:
    try:
        workspace = Workspace(take_distro(arguments))
        if not arguments or arguments[0] in ('-h', '--help', 'help'):
            print(USAGE)
            return 0 if arguments else 2
        command, rest = arguments[0], arguments[1:]
        if command in OURS and command != 'test' and rest[:1] in (['-h'], ['--help']):
            print(USAGE)
            return 0
        if command in ('build', 'clean', 'docs', 'shell') and rest:
            raise SetupError(f'{command} takes no arguments.')
        if command == 'clean':
            shutil.rmtree(ROOT / '.tactile', ignore_errors=True)
            return 0
        workspace.ensure()
        if command == 'build':
            return 0
        if command == 'docs':
            return build_site(workspace)
        if command == 'run':
            if not rest:
                raise SetupError('run needs a program, for example: ./tactile run python')
            workspace.execute(rest)
        if command == 'shell':
            print('`tactile` is on the path. `exit` leaves this shell.', file=sys.stderr)
            workspace.execute([os.environ.get('SHELL') or 'sh'])
        if command == 'test':
            return run_tests(workspace, rest)
        workspace.execute([str(workspace.command), *arguments])
    except SetupError as error:
        print(f'tactile: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
