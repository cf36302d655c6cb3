# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile experiment`: a plan of trials, run with prompts, a journal and resume."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import asdict
from itertools import product
from pathlib import Path
import sys
from typing import Any

from tactile_lab.commands.output import Output, refuse_to_replace
from tactile_lab.commands.rig_requests import ExperimentRequest
from tactile_lab.commands.running.live_trials import open_rig
from tactile_lab.experiment.bench import LiveBench
from tactile_lab.experiment.folder import ExperimentFolder, is_experiment, PLAN
from tactile_lab.experiment.journal import write_atomically
from tactile_lab.experiment.loop import AGAIN, KEEP, run_experiment, STOP
from tactile_lab.experiment.plan import (
    ExperimentError,
    ExperimentPlan,
    format_plan,
    list_order,
    PlannedTrial,
    read_plan,
)
from tactile_lab.experiment.progress import FAILED, OUTLIER, Progress

MOST_FAILURES = 3
"""Failures in a row after which an experiment ends, with ``--yes``."""


class Terminal:
    """The person at the rig, asked on the terminal."""

    has_given_up = False

    def __init__(self, output: Output) -> None:
        self._output = output

    def say(self, text: str) -> None:
        self._output.say(text)

    def _ask(self, text: str) -> str:
        self.say(text)
        line = sys.stdin.readline()
        if not line:
            raise ExperimentError(
                'standard input has ended; run the command in a terminal, or use --yes'
            )
        return line.strip().lower()

    def begin_session(self, session_id: str, trials: int) -> bool:
        text = (
            f'session {session_id}, {trials} trials: set up finger and rig anew, unless it has '
            'begun; then Enter (s: stop here, go on another day)'
        )
        return self._ask(text) != 's'

    def mount(self, trial: PlannedTrial, turns_finger: bool) -> None:
        turn = f'turn the finger for {trial.contact}, ' if turns_finger else ''
        self._ask(f'{turn}put {trial.object_label} under the finger, then Enter')

    def choose(self, verdict: str) -> str:
        choices = {'': AGAIN, 's': STOP, **({'k': KEEP} if verdict == OUTLIER else {})}
        keep = ', k: keep it' if verdict == OUTLIER else ''
        while (answer := self._ask(f'Enter: once more{keep}, s: stop')) not in choices:
            self.say(f'"{answer}" is none of these')
        return choices[answer]


class Nobody(Terminal):
    """Nobody at the rig: what fails is tried again, outliers are kept."""

    def __init__(self, output: Output) -> None:
        super().__init__(output)
        self._failures = 0

    def begin_session(self, session_id: str, trials: int) -> bool:
        self.say(f'session {session_id}, {trials} trials')
        return True

    def mount(self, trial: PlannedTrial, turns_finger: bool) -> None:
        self._failures = 0

    def choose(self, verdict: str) -> str:
        if verdict == OUTLIER:
            return KEEP
        self._failures += 1
        self.has_given_up = self._failures >= MOST_FAILURES
        return STOP if self.has_given_up else AGAIN


def run_new(path: Path, plan: ExperimentPlan, *, force: bool, as_json: bool) -> None:
    """Write a plan, and say what it comes to."""
    output = Output(as_json)
    refuse_to_replace([path], force=force)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, format_plan(plan))
    except OSError as error:
        raise ExperimentError(f'cannot write {path}: {error.strerror}') from error
    first = list(dict.fromkeys(t.object_label for t in list_order(plan, plan.session_ids[0])))
    output.say(
        f'{path}: {plan.trial_count} trials: {len(plan.objects)} objects x '
        f'{len(plan.contacts)} contacts x {plan.sessions} sessions x {plan.mountings} mountings x '
        f'{plan.trials} trials; the first block begins with {", ".join(first[:3])}\n'
        f'Run it: tactile experiment {path}'
    )
    output.result({'path': str(path), 'trials': plan.trial_count, 'plan': asdict(plan)})


def run_status(path: Path, *, as_json: bool) -> None:
    """Print how far an experiment is."""
    output = Output(as_json)
    if not is_experiment(path):
        raise ExperimentError(f'{path} is no folder of an experiment')
    folder = ExperimentFolder(path)
    _summarise(folder, folder.read_progress(), output)


def run_plan(request: ExperimentRequest, *, as_json: bool) -> bool:
    """Run what is left of an experiment; return whether it did not give up.

    The order changes under the lock of the journal alone. A block is appended once the rig runs,
    so a call that is refused appends nothing.
    """
    output = Output(as_json)
    if request.yes and not request.ports.simulated:
        raise ExperimentError('--yes is for --simulated: a real plate is put there by a person')
    folder, plan = _find_folder(request)
    if not is_experiment(folder.path):
        folder.set_up(plan)
    operator = Nobody(output) if request.yes else Terminal(output)
    with folder.open_journal() as journal:
        folder.set_up(plan)
        block = _draw_block(folder, request.append, output) if request.append else []
        try:
            if block or folder.read_progress().left():
                _run(request, folder, plan, operator, journal, output, block)
        finally:
            _summarise(folder, folder.read_progress(), output)
    return not operator.has_given_up


def _draw_block(folder: ExperimentFolder, session_id: str, output: Output) -> list[PlannedTrial]:
    """Return the block to append; empty while an earlier one of the session has trials left."""
    if left := folder.appended_left(session_id):
        output.say(f'{session_id}: the appended block goes on, {left} trials are left')
        return []
    return folder.draw_block(session_id)


def _find_folder(request: ExperimentRequest) -> tuple[ExperimentFolder, ExperimentPlan]:
    if is_experiment(request.plan):
        return ExperimentFolder(request.plan), read_plan(request.plan / PLAN)
    plan = read_plan(request.plan)
    return ExperimentFolder(request.folder or request.plan.with_suffix('')), plan


def _run(
    request: ExperimentRequest,
    folder: ExperimentFolder,
    plan: ExperimentPlan,
    operator: Terminal,
    journal: Any,
    output: Output,
    block: list[PlannedTrial],
) -> None:
    with ExitStack() as stack:
        setup = open_rig(request, folder.bags, output, stack)
        if setup.simulated_rig is not None:
            for label, contact in product(plan.objects, plan.contacts):
                setup.simulated_rig.check_mount(plan.protocol, label, contact)
        run_experiment(folder, LiveBench(setup, plan, output), operator, journal, block)


def _summarise(folder: ExperimentFolder, progress: Progress, output: Output) -> None:
    found = progress.to_dict()
    parts = [f'{found["done"]} of {found["planned"]} trials recorded']
    for name, what in (
        ('outliers_kept', 'of them outliers'),
        (FAILED, 'failed and are left out'),
        ('interrupted', 'were interrupted and are left out'),
    ):
        if found[name]:
            parts.append(f'{found[name]} {what}')
    if left := found['sessions_left']:
        parts.append(f'left: {", ".join(left)}; go on with tactile experiment {folder.path}')
    else:
        parts.append(f'complete; train on it with tactile train {folder.path} -o models')
    output.say(f'{folder.path}: {"; ".join(parts)}')
    trials = [asdict(attempt) for attempt in progress.attempts.values()]
    bags = [str(path) for path in folder.list_bags()]
    output.result({'folder': str(folder.path), 'bags': bags, **found, 'trials': trials})
