# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Program that serves simulated rigs on pseudo-terminals and takes commands as JSON lines."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
import json
import math
import os
from pathlib import Path
import signal
import sys
import time
from typing import Any

from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.devices.faults import read_request
from tactile_sim.errors import RigError, TactileSimError, TautTendonError
from tactile_sim.pty_server import RigClock, ServedRig
from tactile_sim.rig import PalpationRig

NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end the server."""

_USAGE = (
    'send {"mount": {"protocol": ..., "object": ..., "contact": ...}}, optionally with '
    '"numbers": [session, mounting, trial], or {"state": true}, '
    'or {"fault": {"device": ..., "kind": ...}}; with several rigs add "rig": number'
)


def main() -> int:
    """Serve until standard input ends, or until the process receives a signal in `NUMBERS`.

    When the rigs are ready, the paths of their ports are printed, as one line of JSON per rig.
    Then each line of standard input is a command in JSON (see ``_USAGE``), which is answered by
    one line. The faults are described in `tactile_sim.devices.faults`.
    """
    parser = argparse.ArgumentParser(
        prog='tactile_sim_rig', description='Serve a simulated palpation rig on pseudo-terminals.'
    )
    parser.add_argument('--seed', type=int, default=0, help='seed of variations and noise')
    parser.add_argument(
        '--links',
        type=Path,
        nargs='+',
        default=[None],
        metavar='DIR',
        help='folder for the ports, symbolic links named guide, tendon and sensor; with several '
        'folders, each gets a rig with the next seed. Default: a new folder',
    )
    parser.add_argument(
        '--description',
        type=Path,
        metavar='DIR',
        help='folder with your rig.yaml, plates.yaml and so on, which override the packaged files',
    )
    parser.add_argument(
        '--mount',
        nargs=3,
        metavar=('PROTOCOL', 'OBJECT', 'CONTACT'),
        help='plate or object under the finger at the start, such as: texture R1 flexion',
    )
    parser.add_argument(
        '--linger',
        type=float,
        default=0.0,
        metavar='S',
        help='time to keep serving after SIGINT, SIGTERM or SIGHUP, so that drivers that are '
        'ended at the same time can bring the rig to rest',
    )
    arguments = parser.parse_args()
    if arguments.seed < 0:
        parser.error('--seed must not be negative')
    ending = _Ending(arguments.linger)
    for number in NUMBERS:
        signal.signal(number, ending.on_signal)
    try:
        catalogue = Catalogue(arguments.description)
        rigs: list[ServedRig] = []
        with ExitStack() as stack:
            for seed, links in enumerate(arguments.links, arguments.seed):
                rig = PalpationRig(seed, catalogue=catalogue)
                if arguments.mount:
                    rig.mount(*arguments.mount)
                rigs.append(ServedRig(rig, links, seed))
                stack.callback(rigs[-1].close)
            for served in rigs:
                _say(served.ports)
            for line in _read_lines(RigClock(rigs), ending):
                _say(_answer(rigs, line))
    except TactileSimError as error:
        sys.stderr.write(f'tactile_sim_rig: {error}\n')
        return 1
    return 0


class _Ending:
    """Ends the program after a signal, either immediately or ``linger_s`` seconds later."""

    def __init__(self, linger_s: float) -> None:
        self._linger_s = linger_s
        self._end_s = math.inf

    def on_signal(self, number: int, frame: object) -> None:
        # Further signals are ignored, because they must not interrupt the removal of the ports.
        for other in NUMBERS:
            signal.signal(other, signal.SIG_IGN)
        self._end_s = time.monotonic() + self._linger_s
        if not self._linger_s > 0:
            raise SystemExit(0)

    @property
    def is_due(self) -> bool:
        """True when ``linger_s`` seconds have passed since the signal."""
        return time.monotonic() >= self._end_s


def _say(message: object) -> None:
    sys.stdout.write(json.dumps(message) + '\n')
    sys.stdout.flush()


def _read_lines(clock: RigClock, ending: _Ending) -> Iterator[bytes]:
    """Yield the lines of standard input, and run the rigs while waiting for them."""
    pending = b''
    while not ending.is_due:
        if not clock.run(0):
            continue
        data = os.read(0, 4096)
        if not data:
            return
        *lines, pending = (pending + data).split(b'\n')
        yield from (line for line in lines if line.strip())


def _answer(rigs: Sequence[ServedRig], line: bytes) -> dict[str, Any]:
    try:
        request = json.loads(line)
    except ValueError as error:
        return {'error': f'this is not JSON: {error}'}
    if not isinstance(request, dict):
        return {'error': _USAGE}
    try:
        served = _choose(rigs, request.get('rig'))
        if request.get('state'):
            return served.rig.read_truth()
        if 'fault' in request:
            served.fault(read_request(request['fault']))
            return {'ok': True}
        wanted = request.get('mount')
        if not isinstance(wanted, dict):
            return {'error': _USAGE}
        numbers = wanted.pop('numbers', None)
        if set(wanted) != {'protocol', 'object', 'contact'} or not _are_numbers(numbers):
            return {'error': _USAGE}
        protocol, label, contact = (str(wanted[key]) for key in ('protocol', 'object', 'contact'))
        return served.rig.mount(protocol, label, contact, numbers)
    except TautTendonError as error:
        return {'error': str(error), 'is_taut': True}
    except TactileSimError as error:
        return {'error': str(error)}


def _choose(rigs: Sequence[ServedRig], number: Any) -> ServedRig:
    """Return the rig with this index. None is accepted if there is only one rig."""
    if number is None and len(rigs) == 1:
        return rigs[0]
    if type(number) is not int or not 0 <= number < len(rigs):
        most = len(rigs) - 1
        raise RigError(f'"rig" is {json.dumps(number)}; it must be a number from 0 to {most}')
    return rigs[number]


def _are_numbers(numbers: Any) -> bool:
    """Return True if ``numbers`` is None or a valid list [session, mounting, trial]."""
    if numbers is None:
        return True
    return (
        isinstance(numbers, list)
        and len(numbers) == 3
        and all(type(number) is int and 0 <= number < 10**6 for number in numbers)
    )


if __name__ == '__main__':
    sys.exit(main())
