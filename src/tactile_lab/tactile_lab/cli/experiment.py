# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Arguments and help of `tactile experiment`; the work is in `tactile_lab.commands`.

Ubuntu 24.04 has Typer 0.9, which refuses ``X | None`` and does not look into annotations
that are strings: so ``Optional[X]``, and no ``from __future__ import annotations`` here.
"""

from pathlib import Path
from typing import Annotated, Any, Optional

import typer
from typer.core import TyperGroup

from tactile_lab.options import (
    GuideOption,
    JsonOption,
    ModelsOption,
    ParamsOption,
    Protocol,
    refusals,
    SeedOption,
    SensorOption,
    SensorTopicOption,
    SimulatedOption,
    TendonOption,
    WatchOption,
)


class RunByDefault(TyperGroup):
    """Takes ``tactile experiment PLAN`` as ``tactile experiment run PLAN``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        is_known = bool(args) and (args[0] in self.commands or args[0] in ('-h', '--help'))
        return super().parse_args(ctx, args if is_known or not args else ['run', *args])


def run(
    plan: Annotated[
        Path, typer.Argument(help='Plan, as `tactile experiment new` writes it, or the folder.')
    ],
    output: Annotated[
        Optional[Path],
        typer.Option('--output', '-o', help="Folder. Default: the plan's name without .yaml."),
    ] = None,
    append: Annotated[
        str,
        typer.Option(
            help='Append a block to this session: each object once more, in each contact.'
        ),
    ] = '',
    models: ModelsOption = None,
    guide: GuideOption = '',
    tendon: TendonOption = '',
    sensor: SensorOption = '',
    sensor_topic: SensorTopicOption = '',
    simulated: SimulatedOption = False,
    params: ParamsOption = None,
    yes: Annotated[
        bool,
        typer.Option(
            '--yes',
            help='Ask nothing, on the simulated rig: what fails is tried again, up to three '
            'times; outliers are kept and marked.',
        ),
    ] = False,
    watch: WatchOption = False,
    seed: SeedOption = 1,
    json_output: JsonOption = False,
) -> None:
    """Run an experiment, or go on with it: prompts, trials, a line of quality for each.

    The order is random within blocks, and drawn before the first trial (`order.csv`). Each
    session is one bag for each call. You are told which plate to put under the finger; each time
    counts as a mounting of its own. A trial that failed, or is unlike the earlier ones of its
    object, is offered again at once. Whatever interrupts (Ctrl-C, a crash, a power cut): the
    same command goes on where it was, with no trial lost and none counted twice.

    `tactile train` and `tactile evaluate` take the folder. A plan's `sessions` may be raised
    later.
    """
    with refusals():
        from tactile_lab.commands.running.experiment import ExperimentRequest, run_plan
        from tactile_lab.commands.running.rig import PortArguments
        from tactile_lab.watch.options import WatchOptions

        is_well = run_plan(
            ExperimentRequest(
                plan=plan,
                folder=output,
                append=append,
                models=models,
                ports=PortArguments(guide, tendon, sensor, simulated, seed, sensor_topic),
                params=params,
                yes=yes,
                watch=WatchOptions() if watch else None,
            ),
            as_json=json_output,
        )
    raise typer.Exit(0 if is_well else 1)


def new(
    path: Annotated[Path, typer.Argument(help='File to write, such as grooves.yaml.')],
    objects: Annotated[
        str, typer.Option(help='Labels of the plates or objects, with commas: R1,R2,C1.')
    ],
    protocol: Annotated[Protocol, typer.Option(help='Which kind of trial.')] = Protocol.texture,
    contacts: Annotated[str, typer.Option(help='flexion, abduction, or both.')] = 'flexion',
    sessions: Annotated[int, typer.Option(help='How often the rig is set up anew.')] = 3,
    mountings: Annotated[
        int, typer.Option(help='How often each object is put under the finger in a session.')
    ] = 2,
    trials: Annotated[int, typer.Option(help='Trials each time.')] = 5,
    seed: SeedOption = 1,
    force: Annotated[bool, typer.Option('--force', help='Replace the file.')] = False,
    json_output: JsonOption = False,
) -> None:
    """Write the plan of an experiment, as YAML with comments.

    Several sessions, best on several days, and several mountings in each tell a model what
    belongs to the object and what to the day. With one session, nothing can be said of a new
    one.
    """
    with refusals():
        from tactile_lab.commands.running.experiment import run_new
        from tactile_lab.experiment.plan import ExperimentPlan

        plan = ExperimentPlan(
            name=path.stem,
            protocol=protocol.value,
            objects=_split(objects),
            contacts=_split(contacts),
            sessions=sessions,
            mountings=mountings,
            trials=trials,
            seed=seed,
        )
        run_new(path, plan, force=force, as_json=json_output)


def status(
    folder: Annotated[Path, typer.Argument(help='Folder of the experiment.')],
    json_output: JsonOption = False,
) -> None:
    """Print how far an experiment is."""
    with refusals():
        from tactile_lab.commands.running.experiment import run_status

        run_status(folder, as_json=json_output)


def _split(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(',') if part.strip())


def make_app(wrap: Any, command_class: Any) -> typer.Typer:
    """Return the commands; ``wrap`` makes each interruptible."""
    app = typer.Typer(
        cls=RunByDefault,
        no_args_is_help=True,
        rich_markup_mode='markdown',
        help='Record objects x sessions x contacts in a random order, with prompts and resume.',
    )
    for command in (run, new, status):
        app.command(cls=command_class)(wrap(command))
    return app
