# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile experiment`: run a plan of trials, with prompts, a journal and resume."""

from dataclasses import asdict, fields
from functools import partial
from itertools import product
from pathlib import Path
import shlex
from typing import Annotated, Any, Optional, TYPE_CHECKING

import typer
from typer.core import TyperGroup

from tactile_lab import options
from tactile_lab.console import Table
from tactile_lab.output import Output, refuse_to_replace
from tactile_lab.usage import WholeNames
from tactile_ros.errors import named_errors, TactileError
from tactile_ros.files import replace_file

if TYPE_CHECKING:
    from tactile_bringup.trial_protocols import TrialRequest
    from tactile_lab.experiment.folder import ExperimentFolder
    from tactile_lab.experiment.loop import TrialOrder
    from tactile_lab.experiment.plan import ExperimentPlan, PlannedTrial


LEAST_TO_TRAIN = 3
"""Smallest number of training trials per contact that must remain in each fold, because the
classifier of three nearest neighbours needs three trials."""

LEAST_FOR_UNKNOWN = 19
"""Smallest number of trials per contact for a false rejection rate of 5 %."""


class RunByDefault(WholeNames, TyperGroup):
    """Treats ``tactile experiment PLAN`` as ``tactile experiment run PLAN``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        is_known = bool(args) and (args[0] in self.commands or args[0] in ('-h', '--help'))
        return super().parse_args(ctx, args if is_known or not args else ['run', *args])


experiment = typer.Typer(
    cls=RunByDefault,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode='markdown',
    help='Record objects x sessions x contacts in a random order, with prompts and resume.',
)

FolderArgument = Annotated[Path, typer.Argument(exists=True, help='Folder of the experiment.')]
TrialArgument = Annotated[
    str, typer.Argument(help='Trial id, as printed by `status`: grooves-s01-m03-t02.')
]
WhyOption = Annotated[str, typer.Option('--why', help='Reason, which is written to the journal.')]


@experiment.command()
def run(
    plan: Annotated[
        Path,
        typer.Argument(
            exists=True,
            help='Plan, as written by `tactile experiment new`, or the folder of an experiment.',
        ),
    ],
    folder: Annotated[
        Optional[Path],
        typer.Option(
            '--output',
            '-o',
            help="Folder of the experiment. Default: the plan's name without .yaml.",
        ),
    ] = None,
    append: Annotated[
        str,
        typer.Option(
            help='Append a block to this session: one more mounting of each object in each '
            'contact. If an earlier appended block is unfinished, it is continued instead.'
        ),
    ] = '',
    models: options.ModelOption = None,
    given: options.RigOptions = options.RIG,
    yes: Annotated[
        bool,
        typer.Option(
            '--yes',
            help='Only for the simulated rig: ask no questions. Failed trials are repeated, and '
            'the experiment ends after three failures in a row. Outliers are kept and marked.',
        ),
    ] = False,
    accept_setup: Annotated[
        bool,
        typer.Option(
            '--accept-setup',
            help='Continue although the set-up (parameters, calibration, devices) has changed '
            'since the last start. The changes are written to the journal.',
        ),
    ] = False,
    watch: options.WatchOption = False,
    seed: options.SeedOption = 1,
    as_json: options.JsonOption = False,
) -> None:
    """Start or continue an experiment: prompts, trials, and one line about each trial.

    Before the first trial, the order of the trials is drawn at random within blocks and written to
    `order.csv`. Each call records one bag per session. The command prompts for the plate to put
    under the finger; each prompt starts a new mounting. If a trial has failed, or differs from
    earlier trials of its object, you can repeat it immediately. After an interruption (Ctrl-C, a
    crash), the same command continues the experiment. No trial is lost, and none is counted twice.

    `tactile train` and `tactile evaluate` accept the folder. You may increase `sessions` in the
    plan later.
    """
    from tactile_bags.experiment_journal import is_experiment
    from tactile_lab.experiment.folder import ExperimentFolder
    from tactile_lab.experiment.live_rig import LiveTrialBackend, open_rig
    from tactile_lab.experiment.loop import NonInteractive, run_experiment, Terminal
    from tactile_lab.experiment.plan import read_plan

    output = Output(as_json)
    if yes and not given.simulated:
        raise TactileError('--yes requires --simulated: on a real rig a person mounts the plates')
    if is_experiment(plan):
        home = ExperimentFolder(plan)
        planned = home.read_plan()
    else:
        home, planned = ExperimentFolder(folder or plan.with_suffix('')), read_plan(plan)
    if given.simulated:
        from tactile_sim.descriptions.catalogue import default_catalogue

        for label, contact in product(planned.objects, planned.contacts):
            default_catalogue().check_mount(planned.protocol, label, contact)
    if not is_experiment(home.path):
        home.set_up(planned)
    operator = (NonInteractive if yes else Terminal)(output, accept_setup)
    ended: str | None = 'interrupted'
    is_error = False
    # The order is changed only while the journal is locked. A block is appended only once the rig
    # runs, so that a call that fails earlier does not change the order.
    with home.open_journal() as journal:
        home.set_up(planned)
        block = _draw_block(home, append, output) if append else []
        try:
            if block or home.read_progress().left():
                with open_rig(given, models, output, seed=seed, watch=watch) as setup:
                    make_request, number = (
                        partial(_make_request, planned),
                        partial(_number, planned),
                    )
                    bench = LiveTrialBackend(setup, output, make_request, number)
                    _, ended = run_experiment(home, bench, operator, journal, block)
            else:
                ended = None
        except Exception as error:
            ended, is_error = str(error), True
            raise
        finally:
            again = _restate(given, models=models, yes=yes, watch=watch, seed=seed)
            _summarise(home, output, ended, is_error, again)
    raise typer.Exit(1 if operator.has_given_up else 0)


def _restate(
    given: options.RigOptions, *, models: Optional[Path], yes: bool, watch: bool, seed: int
) -> str:
    """Return the options of a command that continues on the same rig, quoted for a shell.

    ``--append`` and ``--accept-setup`` are omitted, because they apply to a single call.
    """
    stated = {each.name: getattr(given, each.name) for each in fields(given)}
    stated |= {'models': models, 'yes': yes, 'watch': watch, 'seed': '' if seed == 1 else seed}
    words: list[str] = []
    for name, value in stated.items():
        if value:
            words.append(f'--{name.replace("_", "-")}')
            words += [] if value is True else [str(value)]
    return shlex.join(words)


def _make_request(plan: 'ExperimentPlan', order: 'TrialOrder') -> 'TrialRequest':
    from tactile_bringup.trial_protocols import TrialRequest

    planned = order.planned
    return TrialRequest(
        plan.protocol,
        planned.contact,
        planned.object_label,
        order.trial_id,
        planned.session_id,
        glide_speed_m_s=plan.glide_speed_m_s,
        hold_s=plan.hold_s,
        mounting_id=order.mounting_id,
    )


def _number(plan: 'ExperimentPlan', order: 'TrialOrder') -> tuple[int, int, int]:
    """Return the numbers of session, mounting and trial.

    They select the random deviations of the simulated rig.
    """
    session = plan.session_ids.index(order.planned.session_id)
    return session, order.mounting_number, order.number_in_mounting


def _draw_block(
    folder: 'ExperimentFolder', session_id: str, output: Output
) -> list['PlannedTrial']:
    """Return the trials of the block to append.

    The list is empty if the session has an appended block that is unfinished and is continued.
    """
    if left := folder.appended_left(session_id):
        output.say(
            f'{session_id}: continuing the block that was appended earlier, trials left: {left}'
        )
        return []
    return folder.draw_block(session_id)


@experiment.command()
def new(
    path: Annotated[Path, typer.Argument(help='File to write, such as grooves.yaml.')],
    objects: Annotated[
        str, typer.Option(help='Labels of the plates or objects, separated by commas: R1,R2,C1.')
    ],
    protocol: Annotated[
        str, typer.Option(**options.choice('texture', 'stiffness'), help='Kind of trial.')
    ] = 'texture',
    contacts: Annotated[str, typer.Option(help='flexion, abduction, or both.')] = 'flexion',
    sessions: Annotated[
        int, typer.Option(help='Number of sessions; the rig is set up again for each.')
    ] = 3,
    mountings: Annotated[
        int, typer.Option(help='Mountings of each object in each session and contact.')
    ] = 2,
    trials: Annotated[int, typer.Option(help='Number of trials in each mounting.')] = 5,
    specimens: Annotated[
        int,
        typer.Option(
            help='Number of plates or objects of each label. Mountings alternate between them, so '
            'that an evaluation can hold out one specimen: tactile evaluate --group specimen.'
        ),
    ] = 1,
    seed: options.SeedOption = 1,
    force: Annotated[bool, typer.Option('--force', help='Replace the file.')] = False,
    as_json: options.JsonOption = False,
) -> None:
    """Write the plan of an experiment, as YAML with comments.

    Plan several sessions, if possible on several days, and several mountings in each session.
    Otherwise, a model may learn the day instead of the object. With a single session, the accuracy
    in a new session cannot be estimated.
    """
    from tactile_lab.experiment.plan import ExperimentPlan, format_plan, list_order

    plan = ExperimentPlan(
        name=path.stem,
        protocol=protocol,
        objects=options.split(objects),
        contacts=options.split(contacts),
        sessions=sessions,
        mountings=mountings,
        trials=trials,
        specimens=specimens,
        seed=seed,
    )
    output = Output(as_json)
    unknown = _check_labels(plan)
    refuse_to_replace([path], force=force)
    with named_errors('write', path):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, format_plan(plan).encode())
    first = list(dict.fromkeys(t.object_label for t in list_order(plan, plan.session_ids[0])))
    counts = [
        (plan.trial_count, 'trial'),
        (len(plan.objects), 'object'),
        (len(plan.contacts), 'contact'),
        (plan.sessions, 'session'),
        (plan.mountings, 'mounting'),
        (plan.trials, 'trial'),
    ]
    total, *factors = (f'{n} {name}{"" if n == 1 else "s"}' for n, name in counts)
    output.say(
        f'{path}: {total}: {" x ".join(factors)}; the first block begins with '
        f'{", ".join(first[:3])}'
    )
    if unknown:
        output.say(
            f'{", ".join(unknown)}: only for a real rig; the simulated rig has no such object'
        )
    output.say(_describe_training(plan), f'Run it: tactile experiment {shlex.quote(str(path))}')
    output.result({'path': str(path), 'trials': plan.trial_count, 'plan': asdict(plan)})


def _describe_training(plan: 'ExperimentPlan') -> str:
    """Return sentences: how many trials training needs, and whether the plan has enough."""
    in_contact = plan.trial_count // len(plan.contacts)
    per_session = in_contact // plan.sessions
    held_out, what = (per_session, 'session') if plan.sessions > 1 else (1, 'trial')
    left = in_contact - held_out
    text = (
        f'Training trials: {in_contact} in each contact, {left} if a {what} is held out. At '
        f'least {LEAST_TO_TRAIN} trials must remain, and at least 2 objects are needed. To detect '
        f'unknown objects, a model needs {LEAST_FOR_UNKNOWN} trials in each contact'
    )
    lacks = []
    if len(plan.objects) < 2:
        lacks.append('add an object')
    if left < LEAST_TO_TRAIN:
        lacks.append('too few trials, raise --trials, --mountings or --sessions')
    if plan.sessions < 2:
        lacks.append('with one session, the accuracy in a new session cannot be estimated')
    return '; '.join([text, *lacks])


def _check_labels(plan: 'ExperimentPlan') -> list[str]:
    """Return the labels that the simulated rig does not have.

    Raises `TactileError` when a label belongs to objects of another protocol.
    """
    from tactile_bringup.trial_protocols import PROTOCOLS
    from tactile_sim.descriptions.catalogue import list_objects

    known = {protocol: list_objects(protocol) for protocol in PROTOCOLS}
    own = known.pop(plan.protocol)
    for other, labels in known.items():
        if wrong := [label for label in plan.objects if label in labels and label not in own]:
            raise TactileError(
                f'{", ".join(wrong)} is for {other} trials. Give --protocol {other}, or for '
                f'{plan.protocol} trials {", ".join(own)} or your own labels'
            )
    return [label for label in plan.objects if label not in own]


@experiment.command()
def status(folder: FolderArgument, as_json: options.JsonOption = False) -> None:
    """Print every trial with its id, the progress of the experiment, and all corrections.

    `tactile experiment relabel` and `exclude` accept these ids. ``--json`` also prints the set-up.
    """
    home, output = _find_folder(folder), Output(as_json)
    progress = home.read_progress()
    planned = {trial.key: trial for trial in progress.order}
    columns = ('trial', 'object', 'contact', 'session', 'verdict')
    # The session is also part of the trial id, so its column may be hidden.
    table = Table(*columns, spare=['session', 'contact'])
    for attempt in progress.attempts.values():
        trial = planned[attempt.key]
        verdict = 'excluded' if attempt.excluded is not None else attempt.verdict or 'not known'
        label = attempt.label or trial.object_label
        table.add_row(attempt.trial_id, label, trial.contact, trial.session_id, verdict)
    if progress.attempts:
        output.say(table)
    _summarise(home, output)


@experiment.command()
def relabel(
    folder: FolderArgument,
    trial: TrialArgument,
    label: Annotated[str, typer.Argument(help='Correct label of the object.')],
    why: WhyOption,
    as_json: options.JsonOption = False,
) -> None:
    """Correct the label of a recorded trial.

    The correction is written to the journal; the bags do not change. Every command that reads the
    folder or its bags uses the new label.
    """
    from tactile_lab.experiment.journal import RELABELLED

    home = _find_folder(folder)
    objects = home.read_plan().objects
    if label not in objects:
        raise TactileError(
            f'"{label}" is not an object of this experiment, which has {", ".join(objects)}. To '
            f'exclude the trial: tactile experiment exclude {folder} {trial} --why ...'
        )
    _correct(home, trial, RELABELLED, f'relabelled {label}', as_json, label=label, why=why)


@experiment.command()
def exclude(
    folder: FolderArgument,
    trial: TrialArgument,
    why: WhyOption,
    as_json: options.JsonOption = False,
) -> None:
    """Exclude a recorded trial from training and evaluation.

    The exclusion is written to the journal; the bags do not change. The trial is not recorded
    again. To record more trials, append a block to a session with ``--append``.
    """
    from tactile_lab.experiment.journal import EXCLUDED

    _correct(_find_folder(folder), trial, EXCLUDED, 'excluded', as_json, why=why)


@experiment.command()
def include(
    folder: FolderArgument,
    trial: TrialArgument,
    why: WhyOption,
    as_json: options.JsonOption = False,
) -> None:
    """Undo the exclusion of a recorded trial."""
    from tactile_lab.experiment.journal import INCLUDED

    _correct(_find_folder(folder), trial, INCLUDED, 'included', as_json, why=why)


def _find_folder(path: Path) -> 'ExperimentFolder':
    from tactile_bags.experiment_journal import is_experiment
    from tactile_lab.experiment.folder import ExperimentFolder

    if not is_experiment(path):
        raise TactileError(
            f'{path} is not the folder of an experiment; `tactile experiment PLAN` creates one'
        )
    return ExperimentFolder(path)


def _correct(
    folder: 'ExperimentFolder', trial: str, kind: str, sentence: str, as_json: bool, **values: str
) -> None:
    attempt = folder.correct(trial, kind, **values)
    output = Output(as_json)
    output.say(f'{attempt.trial_id} {sentence}: {values["why"]}')
    output.result({'folder': str(folder.path), 'trial': asdict(attempt)})


def _summarise(
    folder: 'ExperimentFolder',
    output: Output,
    ended: str | None = None,
    is_error: bool = False,
    again: str = '',
) -> None:
    """Print the number of recorded trials, the corrections, and the command to run next.

    ``ended`` is the reason why the command has ended; it is not printed if ``is_error`` is True,
    because the error is printed, too. ``again`` are the options for the command that continues.
    """
    progress = folder.read_progress()
    found = progress.to_dict()
    parts = [f'{found["done"]} of {found["planned"]} trials recorded']
    for name, what in (
        ('outliers_kept', 'outliers kept'),
        ('excluded', 'excluded'),
        ('relabelled', 'relabelled'),
        ('failed', 'failed'),
        ('interrupted', 'interrupted'),
    ):
        if found[name]:
            parts.append(f'{what}: {found[name]}')
    if found['sessions_left']:
        parts.append(f'sessions left: {", ".join(found["sessions_left"])}')
    output.say(f'{folder.path}: {"; ".join(parts)}')
    for attempt in progress.attempts.values():
        if attempt.label is not None:
            output.say(f'   {attempt.trial_id} was relabelled {attempt.label}: {attempt.why}')
        if attempt.excluded is not None:
            output.say(f'   {attempt.trial_id} was excluded: {attempt.excluded}')
    if ended and not is_error and found['sessions_left']:
        output.say(f'Ended: {ended}')
    if found['sessions_left']:
        command = f'tactile experiment {shlex.quote(str(folder.path))} {again}'
        output.say(f'Continue: {command.rstrip()}')
    else:
        output.say(
            f'Complete. Train on it: tactile train {shlex.quote(str(folder.path))} -o models'
        )
    trials = [asdict(attempt) for attempt in progress.attempts.values()]
    bags = [str(path) for path in folder.list_bags()]
    stated = {'folder': str(folder.path), 'bags': bags, 'ended': ended, **found}
    output.result({**stated, 'setup': progress.setup, 'trials': trials})
