# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The folder of an experiment: plan, order, journal and bags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
import itertools
from pathlib import Path
import re

from tactile_bags.experiment_journal import BAGS, JOURNAL, ORDER, PLAN
from tactile_lab.experiment.journal import (
    Attempt,
    Journal,
    note,
    Progress,
    read_journal,
)
from tactile_lab.experiment.plan import (
    ExperimentError,
    ExperimentPlan,
    format_order,
    format_plan,
    list_order,
    MAX_BYTES,
    parse_order,
    PlannedTrial,
    read_plan,
)
from tactile_ros.errors import named_errors, TactileError
from tactile_ros.files import replace_file
from tactile_ros.yaml_files import read_text

_OWN = re.compile(rf'{BAGS}|\.?({re.escape(PLAN)}|{re.escape(ORDER)})(\.(\d+\.)?new)?')
"""Names of the files of an experiment before its first trial, and of unfinished files."""

MAY_GROW = 'sessions'
"""The only entry of a plan that may be changed after the first trial; it may be increased."""


@dataclass(frozen=True)
class ExperimentFolder:
    """The folder of an experiment.

    The random order of the trials is drawn once, and stored in ``order.csv``.
    """

    path: Path

    @property
    def journal(self) -> Path:
        return self.path / JOURNAL

    @property
    def bags(self) -> Path:
        return self.path / BAGS

    def set_up(self, plan: ExperimentPlan) -> None:
        """Create the folder for a plan, or check that the existing folder belongs to the plan.

        If the number of sessions was increased, the order of the new sessions is drawn. Raises
        `TactileError` when the folder cannot be created, contains other files, or was created for
        another plan.
        """
        with named_errors('make the folder', self.path):
            if not (self.path / PLAN).exists():
                found = self.path.iterdir() if self.path.exists() else ()
                if not all(_OWN.fullmatch(each.name) for each in found):
                    raise ExperimentError(
                        f'{self.path} exists, but is not an experiment; name another folder'
                    )
                self.bags.mkdir(parents=True, exist_ok=True)
                replace_file(self.path / ORDER, b'')
                # The plan marks the folder as an experiment, so it is written last.
                replace_file(self.path / PLAN, format_plan(plan).encode())
            self._adopt(plan)

    def _adopt(self, plan: ExperimentPlan) -> None:
        old = read_plan(self.path / PLAN)
        changed = [
            f'{item.name} (was {getattr(old, item.name)})'
            for item in fields(plan)
            if getattr(plan, item.name) != getattr(old, item.name) and item.name != MAY_GROW
        ]
        if plan.sessions < old.sessions:
            changed.append(f'{MAY_GROW} (was {old.sessions})')
        if changed:
            raise ExperimentError(
                f'{self.path} was started with another plan; changed entries: '
                f'{", ".join(changed)}. Undo the change, or name another folder with --output. '
                f'Only {MAY_GROW} may be increased'
            )
        order = self.read_order()
        drawn = {trial.session_id for trial in order}
        for session_id in plan.session_ids:
            if session_id not in drawn:
                order += list_order(plan, session_id)
        replace_file(self.path / ORDER, format_order(order).encode())
        if plan != old:
            replace_file(self.path / PLAN, format_plan(plan).encode())

    def draw_block(self, session_id: str) -> list[PlannedTrial]:
        """Draw the order of a further block of a session; `append` adds it to the experiment.

        The block has one mounting of each object in each contact. Raises `ExperimentError` for an
        unknown session.
        """
        last = self._last_mounting(session_id)
        return list_order(replace(self.read_plan(), mountings=1), session_id, last + 1)

    def append(self, block: Sequence[PlannedTrial]) -> None:
        """Append a block from `draw_block` to the order. The journal must be locked."""
        replace_file(self.path / ORDER, format_order([*self.read_order(), *block]).encode())

    def appended_left(self, session_id: str) -> int:
        """Return the number of remaining trials in the blocks that were appended to a session.

        Raises `ExperimentError` for an unknown session.
        """
        self._last_mounting(session_id)
        plan = self.read_plan()
        planned = len(plan.objects) * len(plan.contacts) * plan.mountings
        left = self.read_progress().left(session_id)
        return sum(trial.mounting > planned for trial in left)

    def _last_mounting(self, session_id: str) -> int:
        order = self.read_order()
        numbers = [trial.mounting for trial in order if trial.session_id == session_id]
        if not numbers:
            raise ExperimentError(
                f'there is no session "{session_id}"; the sessions are '
                f'{", ".join(dict.fromkeys(trial.session_id for trial in order))}'
            )
        return max(numbers)

    def read_plan(self) -> ExperimentPlan:
        return read_plan(self.path / PLAN)

    def read_order(self) -> list[PlannedTrial]:
        path = self.path / ORDER
        try:
            text = read_text(path, MAX_BYTES * 4)
            return parse_order(text) if text else []
        except TactileError as error:
            raise ExperimentError(f'the order {path}: {error}') from error

    def read_progress(self) -> Progress:
        """Return the progress of the experiment, also while another program is running it."""
        entries = read_journal(self.journal) if self.journal.exists() else []
        return Progress(self.read_order(), entries)

    def correct(self, trial: str, kind: str, **values: str) -> Attempt:
        """Write a correction of a recorded trial to the journal; return the corrected attempt.

        The bags are not changed; the corrections are applied when they are read.

        Parameters
        ----------
        trial : str
            Trial id, or the name of a planned trial.
        kind : str
            `RELABELLED`, `EXCLUDED` or `INCLUDED`.
        **values : str
            ``label`` (only for `RELABELLED`) and ``why``.

        Raises
        ------
        ExperimentError
            When there is no such trial, or another program is running the experiment.
        """
        with self.open_journal() as journal:
            progress = Progress(self.read_order(), journal.entries)
            attempt = progress.find(trial)
            progress.take(note(journal, kind, trial_id=attempt.trial_id, **values))
        return attempt

    def open_journal(self) -> Journal:
        return Journal(self.journal)

    def bag_path(self, session_id: str, run: int) -> Path:
        """Return an unused path for the bag of the ``run``-th start of a session."""
        names = (f'{session_id}-{number:02d}' for number in itertools.count(run))
        # If a program was killed, its bag may exist although the journal does not mention it.
        return next(path for name in names if not (path := self.bags / name).exists())

    def list_bags(self) -> list[Path]:
        """Return the bags, sorted by name."""
        return sorted(path for path in self.bags.iterdir() if path.is_dir())
