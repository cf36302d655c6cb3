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

"""The commands that move the rig: its demo, trials, and all of its nodes."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.options import (
    check_paths,
    Contact,
    GuideOption,
    JsonOption,
    ModelsOption,
    NamespaceOption,
    ParamsOption,
    Protocol,
    QuietOption,
    RecalibrateOption,
    RecordOption,
    refusals,
    SeedOption,
    SensorOption,
    SensorTopicOption,
    SimulatedOption,
    TendonOption,
    WatchOption,
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
            help='Few training trials: a quick check that the chain holds, no useful accuracy.'
        ),
    ] = False,
    trials: Annotated[
        int,
        typer.Option(
            min=1,
            max=100,
            help='Live trials, each of five to seven seconds; as many of each kind as of the '
            'others.',
        ),
    ] = 5,
    watch: Annotated[
        bool, typer.Option('--watch/--no-watch', help='Serve the live trials as a page.')
    ] = True,
    json_output: JsonOption = False,
) -> None:
    """The whole chain on the **simulated** rig, in about a minute.

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


def trials(
    protocol: Annotated[Protocol, typer.Argument(help='Which kind of trial.')],
    label: Annotated[
        str, typer.Option('--object', help='The plate or object that lies under the finger.')
    ],
    output: Annotated[
        Path, typer.Option('--output', '-o', help='Bag to record into; must not exist yet.')
    ],
    contact: Annotated[Contact, typer.Option(help='How the finger touches.')] = Contact.flexion,
    count: Annotated[int, typer.Option(min=1, max=10_000, help='How many trials.')] = 1,
    session: Annotated[
        str,
        typer.Option(
            help='Name of the session, such as one that is to go on; part of the names of the '
            'trials. Default: the time.'
        ),
    ] = '',
    mounting: Annotated[
        str,
        typer.Option(
            help='Name of the mounting; name another each time you fix the plate or object anew. '
            'Default: none.'
        ),
    ] = '',
    models: ModelsOption = None,
    guide: GuideOption = '',
    tendon: TendonOption = '',
    sensor: SensorOption = '',
    sensor_topic: SensorTopicOption = '',
    simulated: SimulatedOption = False,
    params: ParamsOption = None,
    watch: WatchOption = False,
    seed: SeedOption = 1,
    json_output: JsonOption = False,
) -> None:
    """Run trials on one plate or object, one after the other, and record them.

    Homes the guide, then repeats the protocol: with ``--models`` each trial is
    classified as well. The bags of several such sessions are what `tactile train` takes.
    On the simulated rig the named plate or object is put under the finger; on a real one
    that is your part, before you press Enter on this command.

    For several objects use `tactile experiment`: with one object a session, a model may learn
    the session instead of the object.
    """
    with refusals():
        check_paths(models, params)
        from tactile_lab.commands.running.rig import PortArguments
        from tactile_lab.commands.running.trials import run_trials, TrialsRequest
        from tactile_lab.watch.options import WatchOptions

        run_trials(
            TrialsRequest(
                protocol=protocol.value,
                object_label=label,
                contact=contact.value,
                count=count,
                bag=output,
                models=models,
                ports=PortArguments(guide, tendon, sensor, simulated, seed, sensor_topic),
                params=params,
                session=session,
                mounting=mounting,
                watch=WatchOptions() if watch else None,
            ),
            as_json=json_output,
        )


def rig(
    models: ModelsOption = None,
    recalibrate: RecalibrateOption = 0,
    guide: GuideOption = '',
    tendon: TendonOption = '',
    sensor: SensorOption = '',
    sensor_topic: SensorTopicOption = '',
    simulated: SimulatedOption = False,
    params: ParamsOption = None,
    namespace: NamespaceOption = '',
    record: RecordOption = None,
    watch: WatchOption = False,
    quiet: QuietOption = False,
    seed: SeedOption = 1,
) -> None:
    """Run all nodes of the rig in this process until Ctrl-C; print each answer.

    Sensor, guide, tendon, trial runner, features and one classifier for each model.
    Trials are then asked for with the action ``trial_runner/run_trial``; to run some
    without any other program, use `tactile trials`.
    """
    with refusals():
        check_paths(models, params)
        from tactile_lab.commands.running.rig import PortArguments, RigRequest, run_rig, View
        from tactile_lab.watch.options import WatchOptions

        run_rig(
            RigRequest(
                models=models,
                ports=PortArguments(guide, tendon, sensor, simulated, seed, sensor_topic),
                params=params,
                namespace=namespace,
                record=record,
                recalibrate=recalibrate,
                view=View(WatchOptions() if watch else None, quiet),
            )
        )
