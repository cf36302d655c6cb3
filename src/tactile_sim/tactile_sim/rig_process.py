# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Starts the simulated rig in its own process and communicates with it."""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import json
import os
from pathlib import Path
import select
import shutil
import subprocess
import sys
import tempfile
import time
from typing import Any, NamedTuple

from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.errors import RigError, TautTendonError

_START_S = 120.0
_ANSWER_S = 10.0
_EXIT_S = 5.0


class RigPorts(NamedTuple):
    """Paths of the rig's ports. They stay the same when a port is unplugged and plugged in."""

    guide: str
    tendon: str
    sensor: str


class SimulatedRig:
    """A simulated rig that runs in its own process; a context manager.

    Parameters
    ----------
    seed : int
        Seed of the variations of the trials and of the sensor's noise.
    links : path or sequence of paths, optional
        Folder for the ports, which are symbolic links named guide, tendon and sensor; by default
        a new folder. With several folders, one rig is started per folder, with the seeds
        ``seed``, ``seed + 1`` and so on. The methods then need the argument ``rig``, which is the
        index of the folder.
    description : path, optional
        Folder of descriptions that override the packaged ones, see `Catalogue`.

    Raises
    ------
    RigError
        When the process does not start, or refuses the description.
    """

    def __init__(
        self,
        seed: int = 0,
        links: str | Path | Sequence[str | Path] | None = None,
        description: str | Path | None = None,
    ) -> None:
        command = [sys.executable, '-m', 'tactile_sim.rig_server', '--seed', str(seed)]
        folders = [links] if isinstance(links, (str, Path)) else links
        if folders:
            command += ['--links', *map(str, folders)]
        if description is not None:
            command += ['--description', str(description)]
        self._complaints = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._complaints,
            bufsize=0,
            # The process gets its own session, so that Ctrl-C in the terminal does not end the
            # rig before its drivers have ended.
            start_new_session=True,
        )
        self._pending = b''
        self._description = Path(description) if description is not None else None
        self._catalogue: Catalogue | None = None
        self._own_folder: Path | None = None
        try:
            self.ports, *_ = [
                RigPorts(**self._read_answer(_START_S)) for _ in folders or ['a new one']
            ]
            if links is None:
                self._own_folder = Path(self.ports.guide).parent
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> SimulatedRig:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def check_mount(self, protocol: str, object_label: str, contact: str) -> None:
        """Check the arguments of `mount` in this process, without a request to the rig.

        Raises `DescriptionError` for an unknown protocol, object or contact.
        """
        self._catalogue = self._catalogue or Catalogue(self._description)
        self._catalogue.check_mount(protocol, object_label, contact)

    def mount(
        self,
        protocol: str,
        object_label: str,
        contact: str,
        numbers: tuple[int, int, int] | None = None,
        rig: int | None = None,
    ) -> dict[str, Any]:
        """Put a plate (texture) or object (stiffness) under the finger.

        ``numbers`` are the numbers of session, mounting and trial, which start at 0. Trials with
        the same session and mounting have the same deviations of session and mounting. If
        ``numbers`` is None, every call starts a new mounting.

        Raises `TautTendonError` when the tendon is tightened, and `RigError` when the process of
        the rig has ended or refuses the request for another reason.
        """
        wanted = {'protocol': protocol, 'object': object_label, 'contact': contact}
        return self._request({'mount': {**wanted, 'numbers': numbers}, 'rig': rig})

    def truth(self, rig: int | None = None) -> dict[str, Any]:
        """Return the true physical state; see `tactile_sim.rig.PalpationRig.read_truth`."""
        return self._request({'state': True, 'rig': rig})

    def fault(
        self,
        device: str,
        kind: str,
        duration_s: float | None = None,
        rig: int | None = None,
        **options: float,
    ) -> None:
        """Begin a fault of a device; `tactile_sim.devices.faults.KINDS` lists faults and options.

        The kind ``none`` ends all faults of the device. A fault ends after ``duration_s`` [s]. If
        this is None, it continues until ``none`` is requested. Some faults are instantaneous.

        Raises `RigError` for an unknown fault, or when the rig has ended.
        """
        wanted = {'device': device, 'kind': kind, 'duration_s': duration_s, **options}
        self._request({'fault': wanted, 'rig': rig})

    def close(self) -> None:
        """End the process. May be called repeatedly."""
        process = self._process
        with contextlib.suppress(OSError):
            if process.stdin is not None:
                process.stdin.close()
        for end in (process.terminate, process.kill):
            try:
                process.wait(_EXIT_S)
                break
            except subprocess.TimeoutExpired:
                end()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()
        self._complaints.close()
        if self._own_folder is not None:  # in case the process was killed
            shutil.rmtree(self._own_folder, ignore_errors=True)

    def _request(self, message: dict[str, Any]) -> dict[str, Any]:
        stdin = self._process.stdin
        if stdin is None or stdin.closed:
            raise RigError('the simulated rig is closed')
        try:
            stdin.write(json.dumps(message).encode() + b'\n')
        except OSError:
            raise self._death() from None
        answer = self._read_answer(_ANSWER_S)
        if 'error' in answer:
            kind = TautTendonError if answer.get('is_taut') else RigError
            raise kind(answer['error'])
        return answer

    def _read_answer(self, timeout_s: float) -> dict[str, Any]:
        assert self._process.stdout is not None
        output = self._process.stdout.fileno()
        deadline_s = time.monotonic() + timeout_s
        while b'\n' not in self._pending:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0 or not select.select([output], [], [], left_s)[0]:
                raise RigError(f'the simulated rig did not answer within {timeout_s} s')
            data = os.read(output, 4096)
            if not data:
                raise self._death()
            self._pending += data
        line, self._pending = self._pending.split(b'\n', 1)
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _death(self) -> RigError:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_EXIT_S)
        self._complaints.seek(0)
        said = self._complaints.read().decode(errors='replace').strip().splitlines()
        reason = said[-1] if said else 'it gave no reason'
        return RigError(f'the simulated rig ended with code {self._process.returncode}: {reason}')
