# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile trials`: a session of trials on one plate or object, recorded."""

from __future__ import annotations

from contextlib import ExitStack
import time

from tactile_bringup.trial_protocols import TrialRequest
from tactile_lab.commands.output import Output
from tactile_lab.commands.rig_requests import TrialsRequest
from tactile_lab.commands.running.live_trials import LiveTrial, open_rig, run_live_trials


def run_trials(request: TrialsRequest, *, as_json: bool) -> None:
    """Run the trials and print what was recorded, however they end."""
    output = Output(as_json)
    started = time.strftime('%Y%m%d-%H%M%S')
    session = request.session or started
    # A session that is joined again goes on under names that it does not have yet.
    joined = f'-{started[9:]}' if request.session else ''
    name = f'{session}-{request.protocol}-{request.contact}-{request.label}{joined}'
    trials = [
        TrialRequest(
            request.protocol,
            request.contact,
            request.label,
            f'{name}-{i + 1:04d}',
            session,
            mounting_id=request.mounting,
        )
        for i in range(request.count)
    ]
    live: list[LiveTrial] = []
    try:
        with ExitStack() as stack:
            setup = open_rig(request, request.bag, output, stack)
            run_live_trials(setup, trials, output, live)
    except BaseException as error:
        _summarise(live, request, output, str(error) or 'interrupted')
        raise
    _summarise(live, request, output)


def _summarise(
    live: list[LiveTrial], request: TrialsRequest, output: Output, ended_early: str = ''
) -> None:
    is_there = request.bag.exists()
    parts = [
        f'{len(live)} of {request.count} trials on {request.label}, {request.contact}',
        *(['SIMULATED'] if request.ports.simulated else []),
        *(['ended early'] if ended_early else []),
    ]
    output.say(f'{request.bag if is_there else "no bag"}: {"; ".join(parts)}')
    output.result(
        {
            'simulated': request.ports.simulated,
            'bag': str(request.bag) if is_there else '',
            'asked': request.count,
            'ended_early': ended_early,
            'trials': [trial.to_dict() for trial in live],
        }
    )
