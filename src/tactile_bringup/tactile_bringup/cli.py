# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The ``tactile`` command: arguments and help. The work is in `tactile_bringup.commands`.

Imports of the work are inside the functions: ``--help`` must not wait for ROS.
Ubuntu 24.04 has Typer 0.9, which refuses ``X | None`` and does not look into annotations
that are strings: so ``Optional[X]``, and no ``from __future__ import annotations`` here.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import Annotated, Optional

import typer

app = typer.Typer(
    name='tactile',
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode='markdown',
    pretty_exceptions_enable=False,
    context_settings={'help_option_names': ['-h', '--help']},
    help='Touch through the tendon of a soft robotic finger: texture and stiffness from one '
    'tension signal.',
)

JsonOption = Annotated[
    bool, typer.Option('--json', help='Print the result as JSON on standard output.')
]
SeedOption = Annotated[
    int,
    typer.Option(
        min=0, max=2**32 - 1, help='Seed of everything random: the same seed, the same numbers.'
    ),
]


class Protocol(str, Enum):
    """The two kinds of trial."""

    texture = 'texture'
    stiffness = 'stiffness'


class SimulatedProtocol(str, Enum):
    """What the simulator can do."""

    texture = 'texture'
    stiffness = 'stiffness'
    slip = 'slip'


class Contact(str, Enum):
    """How the finger touches."""

    flexion = 'flexion'
    abduction = 'abduction'


class Classifier(str, Enum):
    """The paper's four."""

    knn = 'knn'
    svm_linear = 'svm_linear'
    svm_rbf = 'svm_rbf'
    tree = 'tree'


class Scaling(str, Enum):
    """What is done to the features before the classifier sees them."""

    standard = 'standard'
    none = 'none'


@contextmanager
def refusals() -> Iterator[None]:
    """Turn the errors that we raise on purpose into one sentence and exit code 2."""
    from tactile_bringup.errors import BringupError
    from tactile_bringup.trial_protocols import ProtocolError
    from tactile_classifier.errors import ClassifierError
    from tactile_features.errors import FeatureError
    from tactile_sim.errors import TactileSimError

    try:
        yield
    except (BringupError, ProtocolError, ClassifierError, FeatureError, TactileSimError) as error:
        typer.echo(f'tactile: {error}', err=True)
        raise typer.Exit(2) from error


@app.command()
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
        typer.Option(help='Few trials: a quick check that the chain holds, no useful accuracy.'),
    ] = False,
    json_output: JsonOption = False,
) -> None:
    """The whole chain on the **simulated** rig, in under three minutes.

    Makes training sets from the simulator, trains and cross-validates the four
    classifiers, then runs live trials: simulated devices on serial lines, the real
    drivers, the trial runner, features, classification. Records them into a bag,
    replays the bag through nodes and through the plain core, and says whether all
    three agree bit for bit.
    """
    with refusals():
        from tactile_bringup.commands.demo import run_demo

        ok = run_demo(output, seed=seed, short=short, as_json=json_output)
    raise typer.Exit(0 if ok else 1)


@app.command()
def simulate(
    protocol: Annotated[SimulatedProtocol, typer.Argument(help='Which kind of trial.')],
    output: Annotated[Path, typer.Option('--output', '-o', help='Folder to write the bags into.')],
    contact: Annotated[
        Optional[list[Contact]],
        typer.Option(help='How the finger touches; give it twice for both. Default: both.'),
    ] = None,
    trials: Annotated[
        int,
        typer.Option(min=1, max=100_000, help='Trials on each plate or object in each session.'),
    ] = 60,
    sessions: Annotated[
        int,
        typer.Option(
            min=1,
            max=1000,
            help='How often the rig is set up anew: trials of one session share its mounting '
            'and temperature.',
        ),
    ] = 1,
    seed: SeedOption = 1,
    description: Annotated[
        Optional[Path],
        typer.Option(
            help='Folder with your own finger, rig, plates or objects: YAML files laid over '
            'those of the package.'
        ),
    ] = None,
    jobs: Annotated[
        int, typer.Option(help='How many processes simulate; -1: one for each core.')
    ] = -1,
    plot: Annotated[
        Optional[Path],
        typer.Option(help='Draw one of the trials into this PNG file.'),
    ] = None,
    json_output: JsonOption = False,
) -> None:
    """Make bags of **simulated** trials, without waiting in real time.

    One bag for each kind of contact, with plates or objects times sessions times trials in
    it. The bags hold the same messages as live recordings, marked as simulated. The same
    seed gives the same bytes, whatever the number of processes.

    Exits with 3 when the simulator found no equilibrium in some trial: such trials are in
    the bag up to that time, end as aborted, and give no features. **slip** trials, in which
    the object is pulled sideways, are only simulated: no rig can run them, and there are no
    slip features yet. Their bag says when each object truly began to slip.
    """
    with refusals():
        from tactile_bringup.commands.simulate import SimulateRequest, run_simulate

        complete = run_simulate(
            SimulateRequest(
                protocol=protocol.value,
                contacts=tuple(dict.fromkeys(c.value for c in contact or list(Contact))),
                trials_per_label=trials,
                sessions=sessions,
                seed=seed,
                folder=output,
                description=description,
                jobs=jobs,
                plot=plot,
            ),
            as_json=json_output,
        )
    raise typer.Exit(0 if complete else 3)


@app.command()
def train(
    bags: Annotated[list[Path], typer.Argument(help='Bags with labelled trials.')],
    output: Annotated[
        Path, typer.Option('--output', '-o', help='Folder to write the model files into.')
    ],
    classifier: Annotated[
        Classifier, typer.Option(help='Which of the four goes into the model file.')
    ] = Classifier.knn,
    scaling: Annotated[
        Optional[Scaling],
        typer.Option(
            help='Scaling in the model file. Default: none for texture, whose features share '
            'one unit; standard for stiffness, whose features do not.'
        ),
    ] = None,
    folds: Annotated[int, typer.Option(min=2, help='Folds of the cross-validation.')] = 6,
    repetitions: Annotated[int, typer.Option(min=1, help='How often it is repeated.')] = 10,
    seed: SeedOption = 0,
    json_output: JsonOption = False,
) -> None:
    """Fit the four classifiers, cross-validate them, write a model file.

    Prints the accuracy of six-fold cross-validation, repeated ten times, for all four
    classifiers with and without scaling. One ONNX file is written for each task and
    kind of contact that the bags hold.
    """
    with refusals():
        from tactile_bringup.commands.train import run_train

        run_train(
            bags,
            output,
            classifier=classifier.value,
            scaling=scaling.value if scaling else None,
            cross_validation={'folds': folds, 'repetitions': repetitions, 'random_state': seed},
            as_json=json_output,
        )


@app.command()
def evaluate(
    recordings: Annotated[
        list[Path],
        typer.Argument(help='One labelled-trials archive (.npz), or bags with labelled trials.'),
    ],
    task: Annotated[
        Optional[Protocol],
        typer.Option(help='Which features to compute. Needed for an archive.'),
    ] = None,
    channel: Annotated[
        Optional[str],
        typer.Option(help='Channel of the archive, or "mean" for the mean of all; default: 0.'),
    ] = None,
    where: Annotated[
        Optional[str],
        typer.Option(
            help='Only trials of which a column of the archive is true, as in --where balanced, '
            'or has a value, as in --where direction=1.'
        ),
    ] = None,
    static_phase: Annotated[
        Optional[str],
        typer.Option(
            help='Part of each trial that counts, in seconds, as in --static-phase 1:5. '
            'Default: all of it.'
        ),
    ] = None,
    group: Annotated[
        Optional[list[str]],
        typer.Option(
            help='Hold out each group of trials that agree in this column, instead of random '
            'folds; may be given several times.'
        ),
    ] = None,
    folds: Annotated[int, typer.Option(min=2, help='Folds of the cross-validation.')] = 6,
    repetitions: Annotated[int, typer.Option(min=1, help='How often it is repeated.')] = 10,
    features: Annotated[
        Optional[str],
        typer.Option(
            help='Only these features, separated by commas, as in --features slope,correlation.'
        ),
    ] = None,
    seed: SeedOption = 0,
    json_output: JsonOption = False,
) -> None:
    """Cross-validate the four classifiers on recordings.

    On your own trials, real or simulated: the same features as the live node, every
    classifier with and without scaling, and the split stated beside each number.
    """
    with refusals():
        from tactile_bringup.commands.evaluate import EvaluateRequest, run_evaluate

        run_evaluate(
            EvaluateRequest(
                recordings=tuple(recordings),
                task=task.value if task else None,
                channel=channel,
                where=where,
                static_phase=static_phase,
                groups=tuple(group or ()),
                folds=folds,
                repetitions=repetitions,
                features=features,
                seed=seed,
            ),
            as_json=json_output,
        )


@app.command()
def replay(
    bag: Annotated[Path, typer.Argument(help='The recording.')],
    models: Annotated[
        Optional[Path],
        typer.Option(help='Folder with the model files. Default: where the recording found them.'),
    ] = None,
    nodes: Annotated[
        bool, typer.Option(help='Send the bag through real nodes as well as the plain core.')
    ] = True,
    json_output: JsonOption = False,
) -> None:
    """Run a recording through features and classification again, and compare.

    Prints *equal*, or the first difference from what was recorded; exits with 1 when
    there is one.
    """
    with refusals():
        from tactile_bringup.commands.replay import run_replay

        equal = run_replay(bag, models, through_nodes=nodes, as_json=json_output)
    raise typer.Exit(0 if equal else 1)


GuideOption = Annotated[str, typer.Option(help='Serial port of the linear guide (Grbl).')]
TendonOption = Annotated[str, typer.Option(help='Serial port of the Dynamixel.')]
SensorOption = Annotated[str, typer.Option(help='Serial port of the load cell.')]
SimulatedOption = Annotated[
    bool, typer.Option('--simulated', help='Start simulated devices and use their ports.')
]
ModelsOption = Annotated[
    Optional[Path], typer.Option(help='Folder with model files, as `tactile train` writes them.')
]
ParamsOption = Annotated[
    Optional[Path], typer.Option(help='YAML file with ROS parameters for the nodes.')
]


@app.command()
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
        str, typer.Option(help="Name of the session, part of the trials' ids. Default: the time.")
    ] = '',
    models: ModelsOption = None,
    guide: GuideOption = '',
    tendon: TendonOption = '',
    sensor: SensorOption = '',
    simulated: SimulatedOption = False,
    params: ParamsOption = None,
    seed: SeedOption = 1,
    json_output: JsonOption = False,
) -> None:
    """Run trials on one plate or object, one after the other, and record them.

    Homes the guide, then repeats the protocol: with ``--models`` each trial is
    classified as well. The bags of several such sessions are what `tactile train` takes.
    On the simulated rig the named plate or object is put under the finger; on a real one
    that is your part, before you press Enter on this command.
    """
    with refusals():
        from tactile_bringup.commands.rig import PortArguments
        from tactile_bringup.commands.trials import TrialsRequest, run_trials

        run_trials(
            TrialsRequest(
                protocol=protocol.value,
                object_label=label,
                contact=contact.value,
                count=count,
                bag=output,
                models=models,
                ports=PortArguments(guide, tendon, sensor, simulated, seed),
                params=params,
                session=session,
            ),
            as_json=json_output,
        )


@app.command()
def rig(
    models: ModelsOption = None,
    guide: GuideOption = '',
    tendon: TendonOption = '',
    sensor: SensorOption = '',
    simulated: SimulatedOption = False,
    params: ParamsOption = None,
    namespace: Annotated[str, typer.Option(help='Namespace of all nodes.')] = '',
    record: Annotated[
        Optional[Path], typer.Option(help='Record into this bag; must not exist yet.')
    ] = None,
    seed: SeedOption = 1,
) -> None:
    """Run all nodes of the rig in this process until Ctrl-C.

    Sensor, guide, tendon, trial runner, features and one classifier for each model.
    Trials are then asked for with the action ``trial_runner/run_trial``; to run some
    without any other program, use `tactile trials`.
    """
    with refusals():
        from tactile_bringup.commands.rig import PortArguments, RigRequest, run_rig

        run_rig(
            RigRequest(
                models=models,
                ports=PortArguments(guide, tendon, sensor, simulated, seed),
                params=params,
                namespace=namespace,
                record=record,
            )
        )


@app.command()
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
    quiet: Annotated[
        bool, typer.Option('--quiet', help='Send nothing to serial ports: listen only.')
    ] = False,
    json_output: JsonOption = False,
) -> None:
    """List what is plugged in and recognised.

    Every serial port with its USB numbers and the names that stay, and what answers there:
    a linear guide (Grbl), a Dynamixel servo, a load cell that sends lines, or an ATI Net F/T
    at an address that you give. Beside it stand the parameters of the node that fit.

    Nothing is moved. A port that speaks by itself is only listened to; a silent one is sent a
    question mark, which Grbl answers and others ignore, and then a Dynamixel ping at each usual
    baud rate. Do not let it ask a silent device of another kind that must not hear that: name
    the ports with ``--port``, or use ``--quiet``. A board that resets when its port is opened
    does so here, too: a Grbl guide must be homed afterwards. Ports that another program has
    open are left alone.
    """
    with refusals():
        from tactile_bringup.commands.devices import run_devices

        run_devices(port or [], net_ft or [], listen_s=listen, is_quiet=quiet, as_json=json_output)


@app.command()
def check(
    guide: GuideOption = '',
    tendon: TendonOption = '',
    sensor: SensorOption = '',
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

    Devices are those whose port is given here, or whose ``port`` (of a Net F/T: ``sensor``)
    stands in ``--params``. No node of the rig may run meanwhile: a port has one user.

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
        from tactile_bringup.commands.check import CheckRequest, run_check
        from tactile_bringup.commands.rig import PortArguments

        is_fit = run_check(
            CheckRequest(
                ports=PortArguments(guide, tendon, sensor, simulated, seed),
                params=params,
                namespace=namespace,
                seconds=seconds,
                may_move=move,
            ),
            as_json=json_output,
        )
    raise typer.Exit(0 if is_fit else 1)


def main() -> int:
    """Entry point of the console script."""
    try:
        app()
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    return 0
