# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The journal of an experiment: one line of JSON an entry, on the disk before the next step.

Entries are only ever appended. The state of an experiment is what its entries add up to, so
whatever ends the program, it goes on where the last entry stands.
"""

from __future__ import annotations

import fcntl
import json
import os
from pathlib import Path
from typing import Any, IO

from tactile_lab.experiment.plan import ExperimentError

Entry = dict[str, Any]


class Journal:
    """A journal that is open for one program; a context manager.

    Parameters
    ----------
    path : Path
        Made when it is not there.

    Attributes
    ----------
    entries : list of dict
        All entries, the oldest first.

    Raises
    ------
    ExperimentError
        When it cannot be read or written, or another program has it open.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file: IO[bytes] | None = None
        try:
            is_new = not path.exists()
            self._file = path.open('ab+')
            self._lock()
            if is_new:
                sync_folder(path.parent)
            self._file.seek(0)
            self.entries, length = parse_journal(self._file.read())
            # A line that was cut off by a power cut must not run into the next one.
            self._file.truncate(length)
        except OSError as error:
            self.close()
            raise ExperimentError(f'cannot open the journal {path}: {error.strerror}') from error
        except ExperimentError as error:
            self.close()
            raise ExperimentError(f'the journal {path}: {error}') from error

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _lock(self) -> None:
        assert self._file is not None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ExperimentError(
                'another program runs this experiment; end that one first'
            ) from None

    def append(self, kind: str, **values: Any) -> Entry:
        """Write an entry, and return it once it is on the disk.

        Raises
        ------
        ExperimentError
            When it cannot be written.
        """
        if self._file is None:
            raise ExperimentError(f'the journal {self.path} is closed')
        entry = {'kind': kind, **values}
        try:
            self._file.write(json.dumps(entry, allow_nan=False).encode() + b'\n')
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            self.close()  # nothing may follow half of a line; the next program takes it off
            raise ExperimentError(
                f'cannot write the journal {self.path}: {error.strerror}'
            ) from error
        self.entries.append(entry)
        return entry

    def close(self) -> None:
        """Let others open it. Harmless when called twice."""
        if self._file is not None:
            self._file.close()
            self._file = None


def read_journal(path: Path) -> list[Entry]:
    """Return the entries of a journal, which another program may be writing.

    Raises
    ------
    ExperimentError
        When it cannot be read.
    """
    try:
        return parse_journal(path.read_bytes())[0]
    except OSError as error:
        raise ExperimentError(f'cannot read the journal {path}: {error.strerror}') from error
    except ExperimentError as error:
        raise ExperimentError(f'the journal {path}: {error}') from error


def parse_journal(data: bytes) -> tuple[list[Entry], int]:
    """Return the entries, and the length of what holds them [byte].

    What follows the last whole line was cut off and is no entry. A power cut can also leave
    zeros there, so damaged lines at the end are none either.

    Raises
    ------
    ExperimentError
        When a line is damaged that others follow.
    """
    entries: list[Entry] = []
    length = position = 0
    damaged = 0
    for number, line in enumerate(data.split(b'\n')[:-1], start=1):
        position += len(line) + 1
        entry = _parse_line(line)
        if entry is None:
            damaged = damaged or number
        elif damaged:
            raise ExperimentError(f'line {damaged} is damaged; restore it from a copy')
        else:
            entries.append(entry)
            length = position
    return entries, length


def _parse_line(line: bytes) -> Entry | None:
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        return None
    is_entry = isinstance(entry, dict) and isinstance(entry.get('kind'), str)
    return entry if is_entry else None


def write_atomically(path: Path, text: str) -> None:
    """Replace a file at once, and have it on the disk: there is never half of one."""
    temporary = path.with_name(f'.{path.name}.new')
    with temporary.open('w', encoding='utf-8') as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
