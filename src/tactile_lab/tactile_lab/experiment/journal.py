# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The journal of an experiment, and the progress that is computed from its entries.

The journal has one JSON entry per line. Entries are only appended, and each entry is on the disk
before the next step of the experiment. After any interruption, the experiment continues after the
last entry.
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
from tactile_ros.errors import TactileError
from tactile_ros.files import sync_folder

Entry = dict[str, Any]

GOOD, OUTLIER, FAILED, ABORTED = 'good', 'outlier', 'failed', 'aborted'
"""Verdicts on a trial: usable; usable, but different from similar trials; unusable;
interrupted."""

BEGAN, ENDED, KEPT, MOUNTED, RUN = 'began', 'ended', 'kept', 'mounted', 'run'
SETUP = 'setup'
RELABELLED, EXCLUDED, INCLUDED = 'relabelled', 'excluded', 'included'
"""Kinds of entries of the journal."""


class EntryLog:
    """A list of entries in memory, oldest first. `Journal` also writes them to a file."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []

    def append(self, kind: str, **values: Any) -> Entry:
        """Add an entry and return it."""
        self.entries.append({'kind': kind, **values})
        return self.entries[-1]


def note(log: EntryLog, kind: str, **values: Any) -> Entry:
    """Add an entry with the current time, and return it."""
    return log.append(kind, at_s=round(time.time(), 3), **values)


@contextmanager
def _named_errors(task: str, path: Path) -> Iterator[None]:
    """Convert errors to an `ExperimentError` that names the file of the journal."""
    try:
        yield
    except OSError as error:
        raise ExperimentError(f'cannot {task} the journal {path}: {error.strerror}') from error
    except TactileError as error:
        raise ExperimentError(f'the journal {path}: {error}') from error


class Journal(EntryLog):
    """The journal in a file, which this program locks. It is a context manager.

    The file is created if it does not exist. ``entries`` are all entries, oldest first.

    Raises `ExperimentError` when the journal cannot be read or written, or another program has
    locked it.
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
            # Remove a line that a power cut has truncated, so that the next entry is not joined to
            # it.
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
                'another program is running this experiment; end that program first'
            ) from None

    def append(self, kind: str, **values: Any) -> Entry:
        """Write an entry; return it when it is on the disk.

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
            # The line may be incomplete, so no further entry may follow. The next program that
            # opens the journal removes the line.
            with suppress(OSError):  # close() tries to write the rest of the line
                self.close()
            raise
        self.entries.append(entry)
        return entry

    def close(self) -> None:
        """Unlock the journal. May be called repeatedly."""
        self._file.close()


def read_journal(path: Path) -> list[Entry]:
    """Return the entries of a journal, also while another program is writing it.

    Raises `ExperimentError` when it cannot be read.
    """
    with _named_errors('read', path):
        return parse_journal(path.read_bytes())[0]


@dataclass
class Attempt:
    """One attempt at a planned trial.

    ``key`` is the name of the planned trial, of which at most one attempt is kept. ``verdict`` is
    None if the end of the attempt was not recorded, for example after a power cut. ``statistics``
    are used to find outliers. ``label`` is the corrected label and ``why`` the reason of the
    correction; both are None if the recorded label is right. ``excluded`` is the reason why the
    trial was excluded later, or None.
    """

    key: str
    trial_id: str
    mounting_id: str
    verdict: str | None = None
    sentence: str = ''
    is_kept: bool = False
    label: str | None = None
    why: str | None = None
    excluded: str | None = None
    statistics: dict[str, float] = field(default_factory=dict)


class Progress:
    """The progress of an experiment, computed from the order of its trials and its journal.

    Attributes
    ----------
    order : list of PlannedTrial
        All planned trials.
    attempts : dict
        Attempts at trials, in the order of their start; the keys are trial ids.
    mounting_ids : list of str
        Ids of the mountings, in the order in which objects were mounted.
    runs : dict
        Number of starts of the nodes in each session.
    setup : dict
        Set-up of the rig at the last start; empty if unknown.

    Raises
    ------
    ExperimentError
        When an entry is invalid.
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
        """Update the progress with an entry."""
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
            self.attempts[str(entry['trial_id'])].excluded = None

    def _keep(self, attempt: Attempt) -> None:
        if attempt.key in self._kept:
            raise ValueError(f'trial {attempt.key} is kept twice')
        attempt.is_kept = True
        self._kept[attempt.key] = attempt

    @property
    def done_count(self) -> int:
        """Number of planned trials that have a kept attempt."""
        return sum(trial.key in self._kept for trial in self.order)

    @property
    def outlier_count(self) -> int:
        """Number of outliers that the operator has kept."""
        return sum(attempt.verdict == OUTLIER for attempt in self._kept.values())

    @property
    def last(self) -> Attempt:
        """The latest attempt; at least one trial must have begun."""
        return next(reversed(self.attempts.values()))

    def find(self, name: str) -> Attempt:
        """Return an attempt by its trial id, or the kept attempt by the name of a planned trial.

        Raises `ExperimentError` when there is no such attempt.
        """
        if attempt := self._kept.get(name) or self.attempts.get(name):
            return attempt
        near = get_close_matches(name, self.attempts, n=1, cutoff=0.0)
        hint = f'; did you mean {near[0]}?' if near else '; no trial is recorded yet'
        raise ExperimentError(f'there is no trial "{name}"{hint}')

    def kept(self, key: str) -> Attempt | None:
        """Return the kept attempt at a planned trial, or None."""
        return self._kept.get(key)

    def left(self, session_id: str | None = None) -> list[PlannedTrial]:
        """Return the remaining trials, in their order.

        If ``session_id`` is None, the trials of all sessions are returned.
        """
        return [
            trial
            for trial in self.order
            if trial.key not in self._kept and session_id in (None, trial.session_id)
        ]

    def sessions_left(self) -> list[str]:
        """Return the sessions that have remaining trials, in their order."""
        return list(dict.fromkeys(trial.session_id for trial in self.left()))

    def next_trial_id(self, key: str) -> str:
        """Return an unused trial id for the next attempt at a trial."""
        count = sum(attempt.key == key for attempt in self.attempts.values())
        return f'{key}-again{count}' if count else key

    def next_mounting_id(self, trial: PlannedTrial) -> str:
        """Return the id of the next mounting of a trial's object.

        After an interruption the object is mounted again, and the new mounting has another id.
        """
        name = f'{trial.session_id}-m{trial.mounting:02d}'
        count = sum(each == name or each.startswith(f'{name}-') for each in self.mounting_ids)
        return f'{name}-{count + 1}' if count else name

    def earlier(self, trial: PlannedTrial) -> list[tuple[str, dict[str, float]]]:
        """Return mounting and statistics of each good trial of the same object and contact.

        Excluded trials, and trials that were relabelled as another object, are omitted.
        """
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
            and attempt.excluded is None
            and attempt.label in (None, trial.object_label)
        ]

    def estimate_left_s(self) -> float:
        """Return the estimated duration of the remaining trials [s].

        It is the number of remaining trials times their median duration so far, plus the same
        product for mountings. At least one trial must have ended.
        """
        left = self.left()
        mountings = {(trial.session_id, trial.mounting) for trial in left}
        return median(self._trial_s) * len(left) + median(self._mounting_s) * len(mountings)

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers of trials and mountings as a dictionary for JSON."""
        verdicts = [attempt.verdict for attempt in self.attempts.values()]
        return {
            'planned': len(self.order),
            'done': self.done_count,
            'outliers_kept': self.outlier_count,
            'excluded': sum(attempt.excluded is not None for attempt in self._kept.values()),
            'relabelled': sum(attempt.label is not None for attempt in self._kept.values()),
            'attempts': len(verdicts),
            'failed': verdicts.count(FAILED),
            'interrupted': verdicts.count(ABORTED) + verdicts.count(None),
            'mountings': len(self.mounting_ids),
            'sessions_left': self.sessions_left(),
        }
