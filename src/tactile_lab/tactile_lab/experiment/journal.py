# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The journal of an experiment, and the progress that its entries add up to.

The journal is one line of JSON an entry, on the disk before the next step. Entries are only ever
appended. Whatever ends the program, the experiment goes on where the last entry stands.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack, suppress
from dataclasses import dataclass, field
from difflib import get_close_matches
import fcntl
import json
import os
from pathlib import Path
from statistics import median
import time
from typing import Any

from tactile_bags.experiment_journal import parse_journal
from tactile_lab.experiment.plan import ExperimentError, PlannedTrial
from tactile_lab.output import sync_folder
from tactile_ros.errors import TactileError

Entry = dict[str, Any]

GOOD, OUTLIER, FAILED, ABORTED = 'good', 'outlier', 'failed', 'aborted'
"""Verdicts on a trial: usable; usable but unlike the others; not usable; interrupted."""

BEGAN, ENDED, KEPT, MOUNTED, RUN = 'began', 'ended', 'kept', 'mounted', 'run'
SETUP = 'setup'
RELABELLED, EXCLUDED, INCLUDED = 'relabelled', 'excluded', 'included'
"""Kinds of entries."""


class Notes:
    """Entries, oldest first, that end with the program."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []

    def append(self, kind: str, **values: Any) -> Entry:
        """Add an entry; return it once it is where it stays."""
        self.entries.append({'kind': kind, **values})
        return self.entries[-1]


def note(log: Notes, kind: str, **values: Any) -> Entry:
    """Add an entry with the time of day."""
    return log.append(kind, at_s=round(time.time(), 3), **values)


@contextmanager
def _named_errors(task: str, path: Path) -> Iterator[None]:
    """Raise what is wrong with a journal as an `ExperimentError` that names it."""
    try:
        yield
    except OSError as error:
        raise ExperimentError(f'cannot {task} the journal {path}: {error.strerror}') from error
    except TactileError as error:
        raise ExperimentError(f'the journal {path}: {error}') from error


class Journal(Notes):
    """A journal that is open for one program; a context manager.

    ``path``: made when it is not there. ``entries``: all entries, the oldest first.

    Raises `ExperimentError` when it cannot be read or written, or another program has it open.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path
        with _named_errors('open', path), ExitStack() as stack:
            is_new = not path.exists()
            self._file = stack.enter_context(path.open('ab+'))
            self._lock()
            if is_new:
                sync_folder(path.parent)
            self._file.seek(0)
            self.entries, length = parse_journal(self._file.read())
            # A line that was cut off by a power cut must not run into the next one.
            self._file.truncate(length)
            stack.pop_all()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ExperimentError(
                'another program runs this experiment; end that one first'
            ) from None

    def append(self, kind: str, **values: Any) -> Entry:
        """Write an entry, and return it once it is on the disk.

        Raises `ExperimentError` when it cannot be written.
        """
        if self._file.closed:
            raise ExperimentError(f'the journal {self.path} is closed')
        entry = {'kind': kind, **values}
        try:
            with _named_errors('write', self.path):
                self._file.write(json.dumps(entry, allow_nan=False).encode() + b'\n')
                self._file.flush()
                os.fsync(self._file.fileno())
        except ExperimentError:
            # Nothing may follow half of a line; the next program takes it off.
            with suppress(OSError):  # closing writes what is left once more
                self.close()
            raise
        self.entries.append(entry)
        return entry

    def close(self) -> None:
        """Let others open it. Harmless when called twice."""
        self._file.close()


def read_journal(path: Path) -> list[Entry]:
    """Return the entries of a journal, which another program may be writing.

    Raises `ExperimentError` when it cannot be read.
    """
    with _named_errors('read', path):
        return parse_journal(path.read_bytes())[0]


@dataclass
class Attempt:
    """One trial that was begun.

    Its verdict is empty while it is not known, as after a power cut. One attempt is kept for each
    planned trial's key. The check for outliers compares the statistics. ``label`` is the right
    one where the recorded one is wrong (``why``), ``excluded`` why it does not count after all.
    """

    key: str
    trial_id: str
    mounting_id: str
    verdict: str = ''
    sentence: str = ''
    is_kept: bool = False
    label: str = ''
    why: str = ''
    excluded: str = ''
    statistics: dict[str, float] = field(default_factory=dict)


class Progress:
    """The state of an experiment.

    ``entries``: of the journal.

    ``attempts``: by trial id, in the order in which they were begun. ``mounting_ids``: in the
    order in which objects were put under the finger. ``runs``: how often the nodes were started,
    by session. ``setup``: the rig's set-up at the last start; empty: not known.

    Raises `ExperimentError` when an entry is not of the form that it must have.
    """

    def __init__(
        self, order: Sequence[PlannedTrial], entries: Iterable[Mapping[str, Any]]
    ) -> None:
        self.order = list(order)
        self.attempts: dict[str, Attempt] = {}
        self.mounting_ids: list[str] = []
        self.runs: dict[str, int] = {}
        self.setup: dict[str, str] = {}
        self._kept: dict[str, Attempt] = {}
        self._trial_s: list[float] = []
        self._mounting_s: list[float] = []
        count = 0
        try:
            for entry in entries:
                count += 1
                self.take(entry)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise ExperimentError(f'entry {count} of the journal: {error!r}') from error

    def take(self, entry: Mapping[str, Any]) -> None:
        """Take in an entry."""
        kind = entry['kind']
        if kind == RUN:
            session_id = str(entry['session_id'])
            self.runs[session_id] = self.runs.get(session_id, 0) + 1
        elif kind == MOUNTED:
            self.mounting_ids.append(str(entry['mounting_id']))
            self._mounting_s.append(float(entry['seconds']))
        elif kind == BEGAN:
            trial_id = str(entry['trial_id'])
            attempt = Attempt(str(entry['key']), trial_id, str(entry['mounting_id']))
            self.attempts[trial_id] = attempt
        elif kind == ENDED:
            attempt = self.attempts[str(entry['trial_id'])]
            attempt.verdict = str(entry['verdict'])
            attempt.sentence = str(entry['sentence'])
            attempt.statistics = {str(k): float(v) for k, v in entry['statistics'].items()}
            self._trial_s.append(float(entry['seconds']))
            if attempt.verdict == GOOD:
                self._keep(attempt)
        elif kind == KEPT:
            self._keep(self.attempts[str(entry['trial_id'])])
        elif kind == SETUP:
            self.setup = {str(k): str(v) for k, v in entry['values'].items()}
        elif kind == RELABELLED:
            attempt = self.attempts[str(entry['trial_id'])]
            attempt.label, attempt.why = str(entry['label']), str(entry['why'])
        elif kind == EXCLUDED:
            self.attempts[str(entry['trial_id'])].excluded = str(entry['why'])
        elif kind == INCLUDED:
            self.attempts[str(entry['trial_id'])].excluded = ''

    def _keep(self, attempt: Attempt) -> None:
        if attempt.key in self._kept:
            raise ValueError(f'trial {attempt.key} is kept twice')
        attempt.is_kept = True
        self._kept[attempt.key] = attempt

    @property
    def done_count(self) -> int:
        """Number of planned trials that are done."""
        return sum(trial.key in self._kept for trial in self.order)

    @property
    def outlier_count(self) -> int:
        """Number of trials that are kept although they are unlike the others."""
        return sum(attempt.verdict == OUTLIER for attempt in self._kept.values())

    @property
    def last(self) -> Attempt:
        """The attempt that was begun last; there must be one."""
        return next(reversed(self.attempts.values()))

    def find(self, name: str) -> Attempt:
        """Return the attempt that counts for a planned trial, or any attempt by its trial id.

        Raises `ExperimentError` when there is none.
        """
        if attempt := self._kept.get(name) or self.attempts.get(name):
            return attempt
        near = get_close_matches(name, self.attempts, n=1, cutoff=0.0)
        hint = f'; did you mean {near[0]}?' if near else '; none was recorded yet'
        raise ExperimentError(f'there is no trial "{name}"{hint}')

    def kept(self, key: str) -> Attempt | None:
        """Return the attempt that counts for a planned trial, if it is done."""
        return self._kept.get(key)

    def left(self, session_id: str | None = None) -> list[PlannedTrial]:
        """Return the trials that are left, in their order; of one session or of all."""
        return [
            trial
            for trial in self.order
            if trial.key not in self._kept and session_id in (None, trial.session_id)
        ]

    def sessions_left(self) -> list[str]:
        """Return the sessions that have trials left, in their order."""
        return list(dict.fromkeys(trial.session_id for trial in self.left()))

    def next_trial_id(self, key: str) -> str:
        """Return a name for the next attempt at a trial; no other attempt has it."""
        count = sum(attempt.key == key for attempt in self.attempts.values())
        return f'{key}-again{count}' if count else key

    def next_mounting_id(self, trial: PlannedTrial) -> str:
        """Return a name for putting a trial's object under the finger now.

        After an interruption that is done once more, and so has another name.
        """
        name = f'{trial.session_id}-m{trial.mounting:02d}'
        count = sum(each == name or each.startswith(f'{name}-') for each in self.mounting_ids)
        return f'{name}-{count + 1}' if count else name

    def earlier(self, trial: PlannedTrial) -> list[tuple[str, dict[str, float]]]:
        """Return mounting and statistics of the kept trials of the same object and contact."""
        same = {
            each.key
            for each in self.order
            if (each.object_label, each.contact) == (trial.object_label, trial.contact)
        }
        return [
            (attempt.mounting_id, attempt.statistics)
            for attempt in self._kept.values()
            if attempt.key in same
            and attempt.verdict == GOOD
            and not attempt.excluded
            and attempt.label in ('', trial.object_label)
        ]

    def estimate_left_s(self) -> float:
        """Return how long the trials that are left will take [s], once a trial has been run.

        The sum of the median times of trials and mountings until now.
        """
        left = self.left()
        mountings = {(trial.session_id, trial.mounting) for trial in left}
        return median(self._trial_s) * len(left) + median(self._mounting_s) * len(mountings)

    def to_dict(self) -> dict[str, Any]:
        """Return a summary, as what JSON can hold."""
        verdicts = [attempt.verdict for attempt in self.attempts.values()]
        return {
            'planned': len(self.order),
            'done': self.done_count,
            'outliers_kept': self.outlier_count,
            'excluded': sum(bool(attempt.excluded) for attempt in self._kept.values()),
            'relabelled': sum(bool(attempt.label) for attempt in self._kept.values()),
            'attempts': len(verdicts),
            'failed': verdicts.count(FAILED),
            'interrupted': verdicts.count(ABORTED) + verdicts.count(''),
            'mountings': len(self.mounting_ids),
            'sessions_left': self.sessions_left(),
        }
