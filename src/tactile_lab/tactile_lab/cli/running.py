# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands that run nodes: of the rig, of fingers, and the live page."""

import typer

from tactile_lab.cli.request_options import spread
from tactile_lab.commands.rig_requests import DemoRequest, TrialsRequest
from tactile_lab.options import check_paths, JsonOption


@spread
def demo(request: DemoRequest, as_json: JsonOption = False) -> None:
    """Run everything from training to live trials on the **simulated** rig, in about a minute.

    Makes training sets from the simulator, trains and cross-validates the four
    classifiers, then runs live trials: simulated devices on serial lines, the real
    drivers, the trial runner, features, classification. Records them into a bag,
    replays the bag through nodes and through the plain core, and says whether all
    three agree bit for bit. The address of a live page is printed before the live trials.
    """
    from tactile_lab.commands.running.demo import run_demo

    ok = run_demo(request, as_json=as_json)
    raise typer.Exit(0 if ok else 1)


@spread
def trials(request: TrialsRequest, as_json: JsonOption = False) -> None:
    """Run trials on one plate or object, one after the other, and record them.

    Homes the guide, then repeats the protocol. With ``--models`` each trial is classified as
    well. `tactile train` takes the bags of several such sessions. The simulated rig puts the
    named plate or object under the finger. On a real rig, put it there before you run the
    command.

    For several objects use `tactile experiment`: with one object a session, a model may learn
    the session instead of the object.
    """
    check_paths(request.models, request.params)
    from tactile_lab.commands.running.trials import run_trials

    run_trials(request, as_json=as_json)
