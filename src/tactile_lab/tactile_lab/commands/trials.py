# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile trials`: run and record trials on one plate or object."""

from pathlib import Path
import time
from typing import Annotated, TYPE_CHECKING

import typer

from tactile_lab import options
from tactile_lab.output import Output

if TYPE_CHECKING:
    from tactile_lab.experiment.live_rig import LiveTrial


def trials(
    protocol: options.ProtocolArgument,
    label: Annotated[
        str, typer.Option('--object', help='Label of the plate or object under the finger.')
    ],
    bag: Annotated[
        Path, typer.Option('--output', '-o', help='New bag for the recording; must not exist.')
    ],
    contact: options.ContactOption = 'flexion',
    count: Annotated[int, typer.Option(min=1, max=10_000, help='Number of trials.')] = 1,
    session: Annotated[
        str,
        typer.Option(
            help='Name of the session, which is part of the names of the trials. The name of an '
            'existing session continues that session. Default: the current time.'
        ),
    ] = '',
    mounting: Annotated[
        str,
        typer.Option(
            help='Name of the mounting. Give a new name each time you mount the plate or object. '
            'Default: none.'
        ),
    ] = '',
    models: options.ModelOption = None,
    given: options.RigOptions = options.RIG,
    watch: options.WatchOption = False,
    seed: options.SeedOption = 1,
    as_json: options.JsonOption = False,
) -> None:
    """Run trials on one plate or object, one after the other, and record them.

    Homes the guide, then runs the trials. With ``--models`` each trial is also classified. The
    simulated rig puts the plate or object under the finger; on a real rig, put it there before you
    run the command. A failed trial is repeated once; a second failure ends the command.
    `tactile train` accepts the bags of several calls.

    For several objects use `tactile experiment`. If each session has only one object, a model may
    learn the session instead of the object.
    """
    from tactile_bringup.trial_protocols import TrialRequest
    from tactile_lab.experiment.live_rig import open_rig, run_live_trials

    output = Output(as_json)
    started = time.strftime('%Y%m%d-%H%M%S')
    # In a continued session, the time of day makes the names of the new trials unique.
    joined = f'-{started[9:]}' if session else ''
    session = session or started
    name = f'{session}-{protocol}-{contact}-{label}{joined}'
    requests = [
        TrialRequest(protocol, contact, label, f'{name}-{i:04d}', session, mounting_id=mounting)
        for i in range(1, count + 1)
    ]
    live: list[LiveTrial] = []
    ended_early: str | None = None
    try:
        with open_rig(given, models, output, seed=seed, watch=watch) as setup:
            run_live_trials(setup, bag, requests, output, live)
    except BaseException as error:
        ended_early = str(error) or 'interrupted'
        raise
    finally:
        is_there = bag.exists()
        parts = [
            f'{len(live)} of {count} trials on {label}, {contact}',
            *(['SIMULATED'] if given.simulated else []),
            *(['ended early'] if ended_early else []),
        ]
        output.say(f'{bag if is_there else "no bag"}: {"; ".join(parts)}')
        output.result(
            {
                'simulated': given.simulated,
                'bag': str(bag) if is_there else '',
                'asked': count,
                'ended_early': ended_early,
                'trials': [trial.to_dict() for trial in live],
            }
        )
