# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile demo`: training, live trials and replay on the simulated rig."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
import json
from pathlib import Path
import time
from typing import Annotated, Optional, TYPE_CHECKING

import typer

from tactile_lab import options
from tactile_lab.output import make_output_folder, Output
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_bags.recorded_bag import RecordedBag
    from tactile_bringup.trial_protocols import TrialRequest
    from tactile_classifier.datasets.dataset import FeatureTable
    from tactile_lab.commands.replay import ReplayReport
    from tactile_lab.commands.train import TrainedModel
    from tactile_lab.experiment.live_rig import LiveTrial

PAPER_TRIALS = 60
"""Number of trials on each plate in the paper (section III.A)."""

SESSIONS = 6
"""Number of mountings of each plate in the simulated training trials."""

KINDS = tuple(product(('flexion', 'abduction'), ('texture', 'stiffness')))
"""Contact and protocol of each live trial, in the order in which the trials run."""

TRAVEL_SPEED_M_S = 0.08
"""Speed of the guide without contact in the live trials [m/s], twice the default of the trial
runner, so that the demo takes 3 s less. The glides have the paper's speed."""

STIFFNESS_FEATURES = 'stiffness_relaxation'
"""Feature set of the stiffness trials. The paper's set is more sensitive to a new mounting."""


def demo(
    folder: Annotated[
        Optional[Path],
        typer.Option(
            '--output', '-o', help='Folder for the results; must not exist. Default: a new one.'
        ),
    ] = None,
    seed: options.SeedOption = 1,
    short: Annotated[
        bool,
        typer.Option(
            help='Few training trials: a quick check that all parts work, without useful accuracy.'
        ),
    ] = False,
    trials: Annotated[
        int,
        typer.Option(
            min=1,
            max=100,
            help='Number of live trials of 5 to 7 s, spread evenly over the kinds of trial.',
        ),
    ] = 5,
    watch: Annotated[
        bool,
        typer.Option('--watch/--no-watch', help='Show the live trials on a page in the browser.'),
    ] = True,
    as_json: options.JsonOption = False,
) -> None:
    """Run everything from training to live trials on the **simulated** rig, in about a minute.

    Simulates training trials, trains and cross-validates four classifiers, and then runs live
    trials with the real nodes and drivers; only the devices at the serial ports are simulated. The
    live trials are recorded to a bag. The bag is replayed through new nodes, and through the same
    code without nodes (the plain core). The command reports whether the results are equal, bit for
    bit. The address of a live page is printed before the live trials.
    """
    from tactile_sim.rig_process import SimulatedRig

    started = time.monotonic()
    output = Output(as_json)
    folder = make_folder(folder)
    with ThreadPoolExecutor(1) as thread:
        # The rig is another process, which starts while this one imports modules.
        starting = thread.submit(SimulatedRig, seed)
        from domain_coordinator import domain_id

        from tactile_analysis.datasets.feature_options import FeatureOptions
        from tactile_analysis.datasets.feature_tables import open_trials
        from tactile_bringup.launch_config.graph import Ports
        from tactile_lab.commands.replay import print_report, replay_and_compare
        from tactile_lab.commands.simulate import make_bags
        from tactile_lab.commands.train import read_with_progress, train_models
        from tactile_lab.experiment.live_rig import LiveSetup, run_live_trials
        from tactile_lab.simulation.simulated_bags import paper_plans
        from tactile_lab.watch.access import WatchOptions

    with starting.result() as rig:
        output.say('Everything below comes from a SIMULATED rig: no number is a measurement.\n')

        output.say('[bold]1  Training trials, simulated faster than real time[/bold]', markup=True)
        plans = paper_plans((12 if short else PAPER_TRIALS) // SESSIONS, SESSIONS, seed)
        made = make_bags(folder / 'training', plans, output)
        bags = [bag.path for bag in made]
        output.say(
            f'   {sum(bag.trials for bag in made)} simulated trials in {len(bags)} bags, from '
            f'{SESSIONS} sessions; {time.monotonic() - started:.0f} s\n'
        )

        output.say('[bold]2  Training and cross-validation[/bold]', markup=True)
        feature_options = FeatureOptions(features=STIFFNESS_FEATURES)
        with open_trials(bags, feature_options) as source:
            tables = read_with_progress(source, feature_options, output)
            trained = train_models(
                source, feature_options, tables, folder=folder / 'models', output=output
            )

        output.say(
            '[bold]3  Live trials: from serial ports to classifications[/bold]', markup=True
        )
        output.say('   in a new session: the rig has been set up again after the training trials')
        with domain_id() as domain:
            setup = LiveSetup(
                ports=Ports(rig.ports.guide, rig.ports.tendon, rig.ports.sensor),
                models=folder / 'models',
                simulated_rig=rig,
                parameters={'trial_runner': {'approach_speed_m_s': TRAVEL_SPEED_M_S}},
                domain_id=int(domain),
                watch=WatchOptions() if watch else None,
            )
            requests = choose_trials(seed, trials)
            live = run_live_trials(setup, folder / 'recording', requests, output)

    output.say('\n[bold]4  Replay of the recording[/bold]', markup=True)
    reports = replay_and_compare(folder / 'recording', None, through_nodes=True)
    for report in reports:
        print_report(report, output)

    draw_plots(folder, live, trained)
    summary = {
        'simulated': True,
        'folder': str(folder),
        'seconds': round(time.monotonic() - started, 1),
        'models': [model.to_dict() for model in trained],
        'live_trials': [trial.to_dict() for trial in live],
        'replay': [report.to_dict() for report in reports],
    }
    (folder / 'summary.json').write_text(json.dumps(summary, indent=1, allow_nan=False))
    print_summary(folder, live, reports, output)
    output.say(*(f'   {sentence}' for sentence in explain_misses(live, trained)))
    output.result(summary)
    raise typer.Exit(0 if all(report.is_equal for report in reports) else 1)


def make_folder(folder: Optional[Path]) -> Path:
    """Create the folder for the results, which must not exist."""
    folder = folder or Path(time.strftime('tactile-demo-%Y%m%d-%H%M%S'))
    if folder.exists():
        raise TactileError(f'{folder} exists already; name another folder with -o')
    make_output_folder(folder)
    return folder.resolve()


def choose_trials(seed: int, count: int) -> list['TrialRequest']:
    """Choose the objects of the live trials at random, with equal numbers of each kind of trial.

    Flexion comes first: the finger is remounted only once, before the first abduction.
    """
    import numpy as np

    from tactile_bringup.trial_protocols import TrialRequest
    from tactile_sim.descriptions.catalogue import list_objects

    generator = np.random.default_rng(seed)
    requests: list[TrialRequest] = []
    for kind, (contact, protocol) in enumerate(KINDS):
        labels = list_objects(protocol)
        share = count // len(KINDS) + (kind < count % len(KINDS))
        drawn = [generator.permutation(labels) for _ in range(0, share, len(labels))]
        for label in np.concatenate([*drawn, []])[:share]:
            number = len(requests) + 1
            name = f'live-{number:02d}-{protocol}-{contact}-{label}'
            requests.append(TrialRequest(protocol, contact, str(label), name, 'demo'))
    return requests


def draw_plots(
    folder: Path, live: Sequence['LiveTrial'], trained: Sequence['TrainedModel']
) -> None:
    """Draw the tension of a stiffness trial, and the spectrum of a trial on each plate."""
    from tactile_bags.recorded_bag import RecordedBag

    touched = [
        trial.request
        for trial in live
        if trial.request.protocol == 'stiffness' and trial.request.object_label != 'none'
    ]
    if touched:
        with RecordedBag(folder / 'recording') as bag:
            draw_trace(folder / 'strain_trace.png', bag, touched[0])
    for model in trained:
        if (model.table.task, model.manifest.contact) == ('texture', 'flexion'):
            draw_spectra(folder / 'texture_spectra.png', model.table)


def draw_trace(path: Path, bag: 'RecordedBag', request: 'TrialRequest') -> None:
    """Draw the tension of a recorded stiffness trial with phases, window and fitted line."""
    from tactile_analysis.plots import plot_strain
    from tactile_bags.replay import recorded_results

    (trial,) = (trial for trial in bag.trials('') if trial.name == request.trial_id)
    assert trial.begin_ns is not None
    assert trial.signal.time_s is not None
    (window,) = (w for w in recorded_results(bag).windows if w.trial_id == request.trial_id)
    start_s = (window.window_start_ns - trial.begin_ns) * 1e-9
    end_s = (window.window_end_ns - trial.begin_ns) * 1e-9
    plot_strain(
        path,
        trial.signal.time_s,
        trial.signal.values[0],
        trial.phases,
        f'SIMULATED stiffness trial: {request.contact} on {request.object_label}',
        window_s=(start_s, end_s),
        line=(window.values[0], window.values[1]) if len(window.values) else None,
    )


def draw_spectra(path: Path, table: 'FeatureTable') -> None:
    """Draw the spectrum of the first trial on each plate."""
    import numpy as np

    from tactile_analysis.plots import plot_spectra
    from tactile_sim.descriptions.catalogue import list_objects

    labels = [label for label in list_objects('texture') if label in table.labels]
    plot_spectra(
        path,
        np.arange(len(table.spec.names)) * table.spec.rate_hz / table.spec.sample_count,
        [(label, table.values[np.argmax(table.labels == label)]) for label in labels],
        'SIMULATED texture trials, flexion: one on each plate',
    )


def print_summary(
    folder: Path,
    live: Sequence['LiveTrial'],
    reports: Sequence['ReplayReport'],
    output: Output,
) -> None:
    """Print the summary of the demo."""
    right = sum(trial.is_right for trial in live)
    equal = all(c.is_exact for report in reports for c in report.comparisons.values())
    agreement = 'equal, bit for bit' if equal else 'DIFFERENT'
    output.say(
        f'\n[bold]{right} of {len(live)} live trials classified correctly (SIMULATED rig); '
        f'results of both replays: {agreement}.[/bold]',
        markup=True,
    )
    output.say(f'Results in {folder}:')
    for name, what in (
        ('recording/', 'MCAP bag of the live trials, for `tactile replay`'),
        ('models/', 'model files (.npz), for `tactile rig --models`'),
        ('training/', 'bags of the simulated training trials, for `tactile train`'),
        ('summary.json', 'all numbers'),
        ('strain_trace.png', 'tension during one stiffness trial, with its phases'),
        ('texture_spectra.png', 'amplitude spectrum of one trial on each plate'),
    ):
        output.say(f'   {name:20} {what}')


def explain_misses(live: Sequence['LiveTrial'], trained: Sequence['TrainedModel']) -> list[str]:
    """Return a sentence for each wrong live trial.

    It states how often training trials of the same label were classified as the same wrong label
    in held-out sessions.
    """
    from tactile_classifier.evaluation.cross_validation import evaluate

    tables = {(m.table.task, m.manifest.contact): m for m in trained}
    sentences = []
    for trial in live:
        model = tables.get((trial.request.protocol, trial.request.contact))
        if trial.is_right or trial.answer is None or model is None:
            continue
        label, said = trial.request.object_label, trial.answer.label
        name = f'{trial.request.protocol}, {trial.request.contact}, {label}'
        if not said:
            sentences.append(f'{name}: {trial.answer.reason}')
            continue
        manifest = model.manifest
        (score,) = evaluate(
            model.table, [manifest.classifier], [manifest.scaling], hold_out=['session_id']
        ).scores
        row = score.confusion[score.labels.index(label)]
        taken, whole = int(row[score.labels.index(said)]), int(row.sum())
        sentences.append(
            f'{name}, classified as {said}: when sessions were held out, {taken} of the {whole} '
            f'training trials of {label} were classified as {said}, too'
        )
    return sentences
