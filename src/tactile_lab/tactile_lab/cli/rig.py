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

"""Arguments and help of the commands on devices; the work is in `tactile_lab.commands`.

Ubuntu 24.04 has Typer 0.9, which refuses ``X | None`` and does not look into annotations
that are strings: so ``Optional[X]``, and no ``from __future__ import annotations`` here.
"""

from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.cli.options import (
    check_paths,
    Contact,
    DetectedContact,
    DetectedContactOption,
    GuideOption,
    JsonOption,
    ModelOption,
    ModelsOption,
    NamespaceOption,
    ParamsOption,
    Phases,
    PhasesOption,
    Protocol,
    QuietOption,
    RecalibrateOption,
    RecordOption,
    refusals,
    SeedOption,
    SensorOption,
    SensorTopicOption,
    SimulatedOption,
    SlipOption,
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
        from tactile_lab.commands.demo import run_demo
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
        from tactile_lab.commands.rig import PortArguments
        from tactile_lab.commands.trials import run_trials, TrialsRequest
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
        from tactile_lab.commands.rig import PortArguments, RigRequest, run_rig, View
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


def sense(
    sensor: SensorOption = '',
    sensor_topic: SensorTopicOption = '',
    model: ModelOption = None,
    recalibrate: RecalibrateOption = 0,
    phases: PhasesOption = Phases.stated,
    contact: DetectedContactOption = DetectedContact.unknown,
    slip: SlipOption = False,
    simulated: SimulatedOption = False,
    params: ParamsOption = None,
    namespace: NamespaceOption = '',
    record: RecordOption = None,
    watch: WatchOption = False,
    quiet: QuietOption = False,
) -> None:
    """Run the nodes of one finger that something else moves, in this process until Ctrl-C.

    Sensor, features and classifiers, as ``ros2 launch tactile_bringup sense.launch.py`` starts
    them in processes of their own. Prints a line for each answer. Whoever moves the finger
    publishes trial events on ``trial_runner/events``; or ``--phases`` has them found in the
    tension.
    """
    with refusals():
        check_paths(model, params)
        from tactile_lab.commands.rig import View
        from tactile_lab.commands.sense import run_sensing
        from tactile_lab.watch.options import WatchOptions

        run_sensing(
            'sense',
            {
                'sensor_port': sensor,
                'sensor_topic': sensor_topic,
                **_sensing_values(
                    model, recalibrate, phases, contact, slip, simulated, params, namespace, record
                ),
            },
            View(WatchOptions() if watch else None, quiet),
        )


def hand(
    fingers: Annotated[
        str, typer.Option(help='Namespaces of the fingers, such as index,middle.')
    ] = '',
    hand_file: Annotated[
        Optional[Path],
        typer.Option(
            help="YAML file with each finger's port or topic, model, phases, slip and parameters."
        ),
    ] = None,
    sensor_topic: SensorTopicOption = '',
    model: ModelOption = None,
    recalibrate: RecalibrateOption = 0,
    phases: PhasesOption = Phases.stated,
    contact: DetectedContactOption = DetectedContact.unknown,
    slip: SlipOption = False,
    simulated: SimulatedOption = False,
    params: ParamsOption = None,
    namespace: NamespaceOption = '',
    record: RecordOption = None,
    watch: WatchOption = False,
    quiet: QuietOption = False,
) -> None:
    """Run the nodes of any number of fingers, in this process until Ctrl-C.

    What `tactile sense` runs, once a finger, each in the namespace of its name; as ``ros2
    launch tactile_bringup hand.launch.py`` starts them in processes of their own.
    ``--record`` makes one bag a finger.
    """
    with refusals():
        check_paths(hand_file, model, params)
        from tactile_lab.commands.rig import View
        from tactile_lab.commands.sense import run_sensing
        from tactile_lab.watch.options import WatchOptions

        run_sensing(
            'hand',
            {
                'fingers': fingers,
                'hand_file': str(hand_file or ''),
                'sensor_topic': sensor_topic,
                **_sensing_values(
                    model, recalibrate, phases, contact, slip, simulated, params, namespace, record
                ),
            },
            View(WatchOptions() if watch else None, quiet),
        )


def _sensing_values(
    model: Optional[Path],
    recalibrate: int,
    phases: Phases,
    contact: DetectedContact,
    slip: bool,
    simulated: bool,
    params: Optional[Path],
    namespace: str,
    record: Optional[Path],
) -> dict[str, str]:
    return {
        'model': str(model or ''),
        'recalibrate': str(recalibrate),
        'phases': phases.value,
        'contact': contact.value,
        'slip': 'true' if slip else 'false',
        'rig': 'simulated' if simulated else 'hardware',
        'params_file': str(params or ''),
        'namespace': namespace,
        'record': str(record or ''),
    }


def devices(
    port: Annotated[
        Optional[list[str]],
        typer.Option(
            help='Ask this serial port only; may be given several times. Needed for ports that '
            'the computer does not list, such as those of `tactile_sim_rig --links`.'
        ),
    ] = None,
    net_ft: Annotated[
        Optional[list[str]],
        typer.Option(
            '--net-ft',
            metavar='HOST',
            help='Ask an ATI Net F/T at this address; may be given several times.',
        ),
    ] = None,
    listen: Annotated[
        float,
        typer.Option(
            min=0.1,
            max=60.0,
            help='Seconds to wait for a port that speaks by itself. A board that is reset by '
            'opening its port needs two.',
        ),
    ] = 2.5,
    topics: Annotated[
        bool,
        typer.Option(
            '--topics', help='List topics on which other nodes publish a force, instead of ports.'
        ),
    ] = False,
    quiet: Annotated[
        bool, typer.Option('--quiet', help='Send nothing to serial ports: listen only.')
    ] = False,
    json_output: JsonOption = False,
) -> None:
    """List what is plugged in and recognised.

    Every serial port with its USB numbers and the names that stay, and what answers there:
    a linear guide (Grbl), a Dynamixel servo, a load cell that sends lines, or an ATI Net F/T
    at an address that you give. Beside it stand the parameters of the node that fit. With
    ``--topics``, the forces that other nodes publish on this ROS domain.

    Nothing is moved. A port that speaks by itself is only listened to; a silent one is sent a
    question mark, which Grbl answers and others ignore, and then a Dynamixel ping at each usual
    baud rate. Do not let it ask a silent device of another kind that must not hear that: name
    the ports with ``--port``, or use ``--quiet``. A board that resets when its port is opened
    does so here, too: a Grbl guide must be homed afterwards. Ports that another program has
    open are left alone.
    """
    with refusals():
        from tactile_lab.commands.devices import run_devices

        run_devices(
            port or [],
            net_ft or [],
            topics=topics,
            listen_s=listen,
            is_quiet=quiet,
            as_json=json_output,
        )


def check(
    guide: GuideOption = '',
    tendon: TendonOption = '',
    sensor: SensorOption = '',
    sensor_topic: SensorTopicOption = '',
    simulated: SimulatedOption = False,
    params: ParamsOption = None,
    namespace: Annotated[str, typer.Option(help='Namespace of the nodes in --params.')] = '',
    seconds: Annotated[
        float, typer.Option(min=1.0, max=3600.0, help='How long to listen to the sensor.')
    ] = 5.0,
    move: Annotated[
        bool,
        typer.Option(
            '--move',
            help='Also home the guide and move it 5 mm, and wind the tendon 2 mm in and out.',
        ),
    ] = False,
    seed: SeedOption = 1,
    json_output: JsonOption = False,
) -> None:
    """Exercise each device and print what it found; exit with 1 when something is wrong.

    Devices are those whose port or topic is given here, or whose ``port`` (without one:
    ``sensor``) stands in ``--params``. No node of the rig may run meanwhile: a port has one user.

    **Sensor**: rate against ``rate_hz``, noise, lost samples, error of the time stamps, status
    bits. Leave the tendon alone while it listens.

    **Guide**: version, and the settings that would silently change a glide. The controller is
    reset, with ``--move`` homed, moved and brought back.

    **Tendon**: model, firmware, voltage, temperature, errors, and whether the bus watchdog
    stops the servo in silence. For that the tendon is let loose, then held where it stands,
    and let loose again at the end.

    Each fault comes with its remedy.
    """
    with refusals():
        check_paths(params)
        from tactile_lab.commands.check import CheckRequest, run_check
        from tactile_lab.commands.rig import PortArguments

        is_fit = run_check(
            CheckRequest(
                ports=PortArguments(guide, tendon, sensor, simulated, seed, sensor_topic),
                params=params,
                namespace=namespace,
                seconds=seconds,
                may_move=move,
            ),
            as_json=json_output,
        )
    raise typer.Exit(0 if is_fit else 1)
