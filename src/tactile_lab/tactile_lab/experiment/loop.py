# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The loop of trials: prompts, journal, quality checks, and repetition of failed trials.

`tactile trials`, `tactile demo` and `tactile experiment` use this loop. A `TrialBackend` runs the
trials on a rig. An `Operator` represents the person at the rig.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from itertools import groupby
import math
from pathlib import Path
import sys
import time
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from tactile_lab.experiment.folder import ExperimentFolder
from tactile_lab.experiment.journal import (
    ABORTED,
    BEGAN,
    ENDED,
    EntryLog,
    FAILED,
    GOOD,
    Journal,
    KEPT,
    MOUNTED,
    note,
    OUTLIER,
    Progress,
    RUN,
    SETUP,
)
from tactile_lab.experiment.plan import ExperimentError, PlannedTrial
from tactile_lab.output import Output
from tactile_ros.errors import TactileError

FALSE_ALARMS = 0.001
"""Fraction of ordinary trials that are reported as outliers, if their statistics are normally
distributed."""

FEWEST = 3
"""Smallest number of earlier trials of the same mounting, or of other mountings, with which a
trial is compared."""

SMALLEST_SHARE = 0.02
"""A trial that deviates by less than this fraction of the usual value is not an outlier."""

Statistics = Mapping[str, float]


class Range(NamedTuple):
    """Prediction interval for a statistic of the next trial: ``centre`` +/- ``half_width``."""

    centre: float
    half_width: float


def summarise_tension(tension_n: ArrayLike) -> dict[str, float]:
    """Return mean and standard deviation of the tension in a window [N].

    The dictionary is empty if there is no sample, or if one is not finite.
    """
    values = np.asarray(tension_n, dtype=np.float64)
    if values.size == 0 or not np.isfinite(values).all():
        return {}
    return {'mean_n': float(values.mean()), 'deviation_n': float(values.std())}


def usual_range(
    name: str, mounting_id: str, earlier: Sequence[tuple[str, Statistics]], count: int
) -> Range | None:
    """Return the prediction interval of a statistic; None if there are too few earlier trials.

    If there are n >= `FEWEST` trials of the same mounting, the interval is their mean plus and
    minus t s sqrt(1 + 1/n), where s is the pooled standard deviation within mountings, and t is a
    quantile of Student's distribution. Otherwise, the interval is computed from the means of at
    least `FEWEST` other mountings.

    Parameters
    ----------
    name : str
        Name of the statistic.
    mounting_id : str
        Mounting of the trial.
    earlier : sequence
        Mounting and statistics of each earlier trial of the same object and contact.
    count : int
        Number of statistics that are compared. `FALSE_ALARMS` is divided by it (Bonferroni
        correction).
    """
    known = sorted((m, s[name]) for m, s in earlier if name in s)
    mountings = {
        m: np.array([value for _, value in group])
        for m, group in groupby(known, key=lambda each: each[0])
    }
    within = sum(float(((v - v.mean()) ** 2).sum()) for v in mountings.values())
    freedom = sum(v.size - 1 for v in mountings.values())
    own = mountings.pop(mounting_id, np.empty(0))
    if own.size >= FEWEST:
        spread = math.sqrt(within / freedom * (1.0 + 1.0 / own.size))
        return _interval(float(own.mean()), spread, freedom, count)
    if len(mountings) < FEWEST:
        return None
    means = np.array([v.mean() for v in mountings.values()])
    variance = float(means.var(ddof=1)) * (1.0 + 1.0 / means.size)
    if freedom:
        variance += within / freedom
    return _interval(float(means.mean()), math.sqrt(variance), means.size - 1, count)


def _interval(centre: float, spread: float, freedom: int, count: int) -> Range:
    from scipy.special import stdtrit  # imported lazily: 0.3 s that `--help` does not need

    factor = float(stdtrit(freedom, 1.0 - FALSE_ALARMS / (2 * count)))
    return Range(centre, max(factor * spread, SMALLEST_SHARE * abs(centre)))


def find_outlier(
    statistics: Statistics, mounting_id: str, earlier: Sequence[tuple[str, Statistics]]
) -> str | None:
    """Return a sentence on how a trial differs from earlier ones; None if it is no outlier."""
    for name, value in statistics.items():
        usual = usual_range(name, mounting_id, earlier, len(statistics))
        if usual is not None and abs(value - usual.centre) > usual.half_width:
            return (
                f'{_TITLES.get(name, name)} {value:.3g} N, usually {usual.centre:.3g} ± '
                f'{usual.half_width:.2g} N'
            )
    return None


_TITLES = {'mean_n': 'mean tension', 'deviation_n': 'deviation of the tension'}


AGAIN, KEEP, STOP = 'again', 'keep', 'stop'
"""Choices of an operator after a trial."""

MOST_FAILURES = 3
"""With ``--yes``, an experiment ends after this number of consecutive failures."""


@dataclass(frozen=True)
class TrialOrder:
    """An attempt at a planned trial, to be run by a `TrialBackend`.

    ``number`` and ``count`` are for the progress display: trial 3 of 40. ``following`` is a text
    about the next trial.
    """

    planned: PlannedTrial
    trial_id: str
    mounting_id: str
    mounting_number: int
    number_in_mounting: int
    number: int = 0
    count: int = 0
    following: str = ''


@dataclass(frozen=True)
class TrialResult:
    """Result of a trial that was run to its end.

    Attributes
    ----------
    problem : str or None
        Reason why the recording is unusable; None if it is usable.
    sentence : str
        Summary of the recording.
    statistics : dict
        Statistics of the tension, which are used to find outliers.
    """

    problem: str | None = None
    sentence: str = ''
    statistics: dict[str, float] = field(default_factory=dict)


RunTrial = Callable[[TrialOrder], TrialResult]
"""Function that runs a trial and returns when its recording is on the disk.

It raises `TactileError` when the trial fails, and `ExperimentError` when no further trial is
possible, for example because the disk is full.
"""


class TrialBackend(Protocol):
    """Interface of a rig on which trials are run."""

    def session(self, bag: Path) -> AbstractContextManager[RunTrial]:
        """Start the rig and a recording into ``bag``; end both with the block."""

    def read_setup(self) -> dict[str, str]:
        """Return the set-up of the running rig: parameters and identification of devices."""


class Operator:
    """The person who mounts plates and objects, and decides after failed trials and outliers.

    This base class needs no person: it repeats a failed trial once, and raises an error if the
    trial fails again.
    """

    has_given_up = False

    def __init__(self, output: Output) -> None:
        self._output = output

    def say(self, text: str) -> None:
        """Print a line."""
        self._output.say(text)

    def begin_session(self, session_id: str, trials: int) -> bool:
        """Wait until finger and rig are set up for a session; return False to stop before it."""
        return True

    def accept_setup(self, changes: Sequence[str]) -> bool:
        """Return True to continue although the set-up has changed since the last start."""
        return True

    def mount(self, trial: PlannedTrial, turns_finger: bool) -> None:
        """Wait until the object of the trial is under the finger.

        ``turns_finger`` is True if the finger must be turned from flexion to abduction or back.
        """

    def choose(self, order: TrialOrder, verdict: str, sentence: str) -> str:
        """Return what to do after a failed trial or an outlier: `AGAIN`, `KEEP` or `STOP`."""
        if verdict != FAILED:
            return KEEP
        if order.trial_id != order.planned.key:  # this was the second attempt
            raise TactileError(sentence)
        return AGAIN


class Terminal(Operator):
    """The person at the rig, prompted on the terminal."""

    def __init__(self, output: Output, accepts_setup: bool = False) -> None:
        super().__init__(output)
        self._accepts_setup = accepts_setup

    def _ask(self, text: str) -> str:
        self.say(text)
        line = sys.stdin.readline()
        if not line:
            raise TactileError(
                'standard input has ended; run the command in a terminal, or use --yes'
            )
        return line.strip().lower()

    def begin_session(self, session_id: str, trials: int) -> bool:
        text = (
            f'session {session_id}, {trials} trials: set up finger and rig (not if the session '
            'has already started), then press Enter (s: stop here, continue on another day)'
        )
        return self._ask(text) != 's'

    def accept_setup(self, changes: Sequence[str]) -> bool:
        self._output.say('the set-up has changed since the last start:')
        self._output.say(*(f'   {line}' for line in changes))
        if self._accepts_setup:
            return True
        if not sys.stdin.isatty():
            self.say('to continue with this set-up: --accept-setup')
            self.has_given_up = True
            return False
        return self._ask('y: continue with this set-up, Enter: stop') == 'y'

    def mount(self, trial: PlannedTrial, turns_finger: bool) -> None:
        turn = f'turn the finger for {trial.contact}, ' if turns_finger else ''
        specimen = f' (specimen {trial.specimen})' if trial.specimen else ''
        self._ask(f'{turn}put {trial.object_label}{specimen} under the finger, then press Enter')

    def choose(self, order: TrialOrder, verdict: str, sentence: str) -> str:
        choices = {'': AGAIN, 's': STOP, **({'k': KEEP} if verdict == OUTLIER else {})}
        keep = ', k: keep it' if verdict == OUTLIER else ''
        while (answer := self._ask(f'Enter: repeat{keep}, s: stop')) not in choices:
            self.say(f'"{answer}" is not one of these')
        return choices[answer]


class NonInteractive(Terminal):
    """Operator for the simulated rig: repeats failed trials, keeps outliers, never prompts."""

    _failures = 0

    def begin_session(self, session_id: str, trials: int) -> bool:
        self.say(f'session {session_id}, {trials} trials')
        return True

    def mount(self, trial: PlannedTrial, turns_finger: bool) -> None:
        self._failures = 0

    def choose(self, order: TrialOrder, verdict: str, sentence: str) -> str:
        if verdict == OUTLIER:
            return KEEP
        self._failures += 1
        self.has_given_up = self._failures >= MOST_FAILURES
        return STOP if self.has_given_up else AGAIN


def run_experiment(
    folder: ExperimentFolder,
    bench: TrialBackend,
    operator: Operator,
    journal: Journal,
    appended: Sequence[PlannedTrial] = (),
) -> tuple[Progress, str | None]:
    """Run all remaining trials, unless the operator stops.

    Returns the progress, and the reason why trials remain, which is None if none remains.

    Every step is written to the journal before and after it. A trial is done when its entry is on
    the disk, and the entry is written after the recording. Therefore no trial is lost, and none is
    counted twice.

    Parameters
    ----------
    appended : sequence of PlannedTrial
        A block of trials that is appended to the order once the rig has started.

    Raises
    ------
    TactileError
        When the rig cannot be started, or the recording fails.
    """
    progress = Progress([*folder.read_order(), *appended], journal.entries)
    loop = TrialLoop(progress, operator, journal)
    for session_id in progress.sessions_left():
        if not operator.begin_session(session_id, len(progress.left(session_id))):
            return progress, f'stopped before session {session_id}'
        bag = folder.bag_path(session_id, progress.runs.get(session_id, 0) + 1)
        loop.note(RUN, session_id=session_id, bag=bag.name)
        with bench.session(bag) as run_trial:
            if not loop.check_setup(bench.read_setup(), session_id):
                return progress, 'the set-up was not accepted'
            if appended:
                folder.append(appended)
                operator.say(f'{appended[0].session_id}: {len(appended)} trials appended')
                appended = ()
            if not loop.run_session(session_id, run_trial):
                return progress, f'stopped after trial {progress.last.trial_id}'
    return progress, None


def list_changes(old: dict[str, str], new: dict[str, str]) -> list[str]:
    """Return one line for each value that differs between two set-ups."""
    return [
        f'{name}: {old.get(name, "unknown")} -> {new.get(name, "unknown")}'
        for name in sorted({*old, *new})
        if old.get(name) != new.get(name)
    ]


@dataclass
class TrialLoop:
    """Runs trials and writes their results to the journal."""

    progress: Progress
    operator: Operator
    journal: EntryLog
    contact: str = ''

    def note(self, kind: str, **values: Any) -> None:
        """Write an entry to the journal, and update the progress."""
        self.progress.take(note(self.journal, kind, **values))

    def check_setup(self, setup: dict[str, str], session_id: str) -> bool:
        """Write the set-up to the journal.

        If the set-up has changed and the operator does not accept the changes, return False
        instead. The first set-up is accepted without a question.
        """
        changes = list_changes(self.progress.setup, setup) if self.progress.setup else []
        if changes and not self.operator.accept_setup(changes):
            return False
        self.note(SETUP, session_id=session_id, values=setup, accepted_changes=changes)
        return True

    def run_session(self, session_id: str, run_trial: RunTrial) -> bool:
        """Run the remaining trials of a session; return False if the operator stops."""
        mounted, mounting_id, count = 0, '', 0
        while left := self.progress.left(session_id):
            trial = left[0]
            if trial.mounting != mounted:
                mounting_id = self._mount(trial)
                mounted, count = trial.mounting, 0
            count += 1
            order = TrialOrder(
                trial,
                self.progress.next_trial_id(trial.key),
                mounting_id,
                len(self.progress.mounting_ids),
                count,
                self.progress.done_count + 1,
                len(self.progress.order),
                _describe_next(trial, left[1] if len(left) > 1 else None),
            )
            if not self._run_trial(order, run_trial):
                return False
        return True

    def _mount(self, trial: PlannedTrial) -> str:
        started_s = time.monotonic()
        self.operator.mount(trial, self.contact != trial.contact)
        self.contact = trial.contact
        mounting_id = self.progress.next_mounting_id(trial)
        self.note(
            MOUNTED,
            mounting_id=mounting_id,
            object_label=trial.object_label,
            contact=trial.contact,
            specimen=trial.specimen,
            seconds=time.monotonic() - started_s,
        )
        return mounting_id

    def _run_trial(self, order: TrialOrder, run_trial: RunTrial) -> bool:
        """Run one attempt at a trial; return False if the operator stops."""
        trial = order.planned
        names = {'key': trial.key, 'trial_id': order.trial_id, 'mounting_id': order.mounting_id}
        self.note(BEGAN, **names)
        started_s = time.monotonic()

        def end(verdict: str, sentence: str, statistics: dict[str, float]) -> None:
            self.note(
                ENDED,
                trial_id=order.trial_id,
                verdict=verdict,
                sentence=sentence,
                statistics=statistics,
                seconds=time.monotonic() - started_s,
            )

        try:
            result = run_trial(order)
        except ExperimentError as error:
            end(ABORTED, str(error), {})
            raise
        except TactileError as error:
            result = TrialResult(problem=str(error))
        except BaseException:
            end(ABORTED, 'interrupted', {})
            raise
        earlier = self.progress.earlier(trial)
        if (reason := result.problem) is not None:
            verdict = FAILED
        elif (reason := find_outlier(result.statistics, order.mounting_id, earlier)) is not None:
            verdict = OUTLIER
        else:
            verdict = GOOD
        sentence = '; '.join(part for part in (reason, result.sentence) if part)
        end(verdict, sentence, result.statistics)
        self.operator.say(
            f'trial {self.progress.done_count + (verdict != GOOD)} of '
            f'{len(self.progress.order)}, {order.trial_id}: {trial.object_label}, '
            f'{trial.contact}: {verdict}: {sentence}; '
            f'{format_seconds(self.progress.estimate_left_s())} left'
        )
        if verdict == GOOD:
            return True
        choice = self.operator.choose(order, verdict, sentence)
        if choice == KEEP and verdict == OUTLIER:
            self.note(KEPT, trial_id=order.trial_id)
        return choice != STOP


def _describe_next(trial: PlannedTrial, following: PlannedTrial | None) -> str:
    """Return a text about the trial that follows in the session."""
    if following is None:
        return 'end of the session'
    what = f'{following.object_label}, {following.contact}'
    return f'{what}, to be mounted' if following.mounting != trial.mounting else what


def format_seconds(seconds: float) -> str:
    """Return a duration as text, in s, min or h."""
    if seconds < 90:
        return f'{seconds:.0f} s'
    minutes = round(seconds / 60)
    return f'{minutes} min' if minutes < 90 else f'{minutes // 60} h {minutes % 60:02d} min'
