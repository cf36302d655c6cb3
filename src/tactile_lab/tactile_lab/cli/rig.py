# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands that move the rig: its demo, trials, and all of its nodes."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.cli.request_options import spread
from tactile_lab.commands.rig_requests import RigRequest, TrialsRequest
from tactile_lab.options import (
    check_paths,
    JsonOption,
    refusals,
    SeedOption,
)


def demo(
    output: Annotated[
        Optional[Path],
        typer.Option(
            '--output', '-o', help='Folder for the results; must not exist. Default: a new one.'
        ),
    ] = None,
    seed: SeedOption = 1,
    short: Annotated[
        bool,
        typer.Option(
            help='Few training trials: a quick check that all parts work, no useful accuracy.'
        ),
    ] = False,
    trials: Annotated[
        int,
        typer.Option(
            min=1,
            max=100,
            help='Live trials, five to seven seconds each, spread evenly over the kinds of trial.',
        ),
    ] = 5,
    watch: Annotated[
        bool, typer.Option('--watch/--no-watch', help='Serve the live trials as a page.')
    ] = True,
    json_output: JsonOption = False,
) -> None:
    """Run everything from training to live trials on the **simulated** rig, in about a minute.

    Makes training sets from the simulator, trains and cross-validates the four
    classifiers, then runs live trials: simulated devices on serial lines, the real
    drivers, the trial runner, features, classification. Records them into a bag,
    replays the bag through nodes and through the plain core, and says whether all
    three agree bit for bit. The address of a live page is printed before the live trials.
    """
    with refusals():
        from tactile_lab.commands.running.demo import run_demo
        from tactile_lab.watch.options import WatchOptions

        options = WatchOptions() if watch else None
        ok = run_demo(
            output, seed=seed, short=short, trials=trials, as_json=json_output, watch=options
        )
    raise typer.Exit(0 if ok else 1)


@spread
def trials(request: TrialsRequest, json_output: JsonOption = False) -> None:
    """Run trials on one plate or object, one after the other, and record them.

    Homes the guide, then repeats the protocol. With ``--models`` each trial is classified as
    well. `tactile train` takes the bags of several such sessions. The simulated rig puts the
    named plate or object under the finger. On a real rig, put it there before you run the
    command.

    For several objects use `tactile experiment`: with one object a session, a model may learn
    the session instead of the object.
    """
    with refusals():
        check_paths(request.models, request.params)
        from tactile_lab.commands.running.trials import run_trials

        run_trials(request, as_json=json_output)


@spread
def rig(request: RigRequest) -> None:
    """Run all nodes of the rig in this process until Ctrl-C; print each classification.

    Starts sensor, guide, tendon, trial runner, features and one classifier for each model. Start
    trials with the action ``trial_runner/run_trial``. To run trials without another program, use
    `tactile trials`.
    """
    with refusals():
        check_paths(request.models, request.params)
        from tactile_lab.commands.running.rig import run_rig

        run_rig(request)
