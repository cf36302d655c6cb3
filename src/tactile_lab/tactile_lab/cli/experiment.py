# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile experiment` and its commands; the work is in `tactile_lab.commands`."""

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from tactile_lab.cli.request_options import spread
from tactile_lab.commands.rig_requests import ExperimentRequest
from tactile_lab.options import choice, JsonOption, SeedOption


class RunByDefault(TyperGroup):
    """Takes ``tactile experiment PLAN`` as ``tactile experiment run PLAN``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        is_known = bool(args) and (args[0] in self.commands or args[0] in ('-h', '--help'))
        return super().parse_args(ctx, args if is_known or not args else ['run', *args])


@spread
def run(request: ExperimentRequest, as_json: JsonOption = False) -> None:
    """Start or continue an experiment: prompts, trials, and a line of quality for each trial.

    The order is random within blocks, and drawn before the first trial (`order.csv`). Each
    session is one bag for each call. The command prints which plate to put under the finger; each
    time counts as a mounting of its own. After a trial that failed, or differs from the earlier
    ones of its object, you can repeat it at once. After an interruption (Ctrl-C, a crash) the
    same command continues where it ended. No trial is lost and none is counted twice.

    `tactile train` and `tactile evaluate` take the folder. A plan's `sessions` may be raised
    later.
    """
    from tactile_lab.commands.running.experiment import run_plan

    is_well = run_plan(request, as_json=as_json)
    raise typer.Exit(0 if is_well else 1)


def new(
    path: Annotated[Path, typer.Argument(help='File to write, such as grooves.yaml.')],
    objects: Annotated[
        str, typer.Option(help='Labels of the plates or objects, with commas: R1,R2,C1.')
    ],
    protocol: Annotated[
        str, typer.Option(**choice('texture', 'stiffness'), help='Which kind of trial.')
    ] = 'texture',
    contacts: Annotated[str, typer.Option(help='flexion, abduction, or both.')] = 'flexion',
    sessions: Annotated[int, typer.Option(help='How often the rig is set up anew.')] = 3,
    mountings: Annotated[
        int, typer.Option(help='How often each object is put under the finger in a session.')
    ] = 2,
    trials: Annotated[int, typer.Option(help='Trials each time.')] = 5,
    seed: SeedOption = 1,
    force: Annotated[bool, typer.Option('--force', help='Replace the file.')] = False,
    as_json: JsonOption = False,
) -> None:
    """Write the plan of an experiment, as YAML with comments.

    Plan several sessions, best on several days, and several mountings in each. Then a model
    learns the object and not the day. One session says nothing about the accuracy in a new one.
    """
    from tactile_lab.commands.running.experiment import run_new
    from tactile_lab.experiment.plan import ExperimentPlan

    plan = ExperimentPlan(
        name=path.stem,
        protocol=protocol,
        objects=_split(objects),
        contacts=_split(contacts),
        sessions=sessions,
        mountings=mountings,
        trials=trials,
        seed=seed,
    )
    run_new(path, plan, force=force, as_json=as_json)


def status(
    folder: Annotated[Path, typer.Argument(help='Folder of the experiment.')],
    as_json: JsonOption = False,
) -> None:
    """Print how far an experiment is."""
    from tactile_lab.commands.running.experiment import run_status

    run_status(folder, as_json=as_json)


def _split(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(',') if part.strip())


experiment = typer.Typer(
    cls=RunByDefault,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode='markdown',
    help='Record objects x sessions x contacts in a random order, with prompts and resume.',
)
for command in (run, new, status):
    experiment.command()(command)
