# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arguments and help of the commands on recordings; the work is in `tactile_lab.commands`.

Ubuntu 24.04 has Typer 0.9, which refuses ``X | None`` and does not look into annotations
that are strings: so ``Optional[X]``, and no ``from __future__ import annotations`` here.
"""

from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.cli.request_options import spread
from tactile_lab.commands.analysis.requests import RecordingsArgument, TrainRequest
from tactile_lab.commands.simulate_request import SimulateRequest
from tactile_lab.options import (
    check_paths,
    choice,
    ClusterOption,
    JsonOption,
    refusals,
    SeedOption,
)


@spread
def simulate(
    request: SimulateRequest,
    cluster: ClusterOption = '',
    json_output: JsonOption = False,
) -> None:
    """Make bags of **simulated** trials, without waiting in real time.

    Writes one bag for each kind of contact, with plates or objects times sessions times trials in
    it. The bags hold the same messages as live recordings, marked as simulated. The same
    seed gives the same bytes with the same NumPy, whatever the number of processes.

    Exits with 3 when the simulator found no equilibrium in some trial: such trials are in
    the bag up to that time, end as aborted, and give no features. **slip** trials, in which
    the object is pulled sideways, are only simulated: no rig can run them, and there are no
    slip features yet. Their bag says when each object truly began to slip.
    """
    with refusals():
        check_paths(request.description)
        from tactile_lab.commands.cluster import on_cluster
        from tactile_lab.commands.simulate import run_simulate

        with on_cluster(cluster):
            complete = run_simulate(request, as_json=json_output)
    raise typer.Exit(0 if complete else 3)


@spread
def train(
    recordings: RecordingsArgument,
    request: TrainRequest,
    cluster: ClusterOption = '',
    json_output: JsonOption = False,
) -> None:
    """Fit the four classifiers, cross-validate them, write a model file.

    Prints the accuracy of six-fold cross-validation, repeated ten times, for all four
    classifiers with and without scaling. One ONNX file is written for each task and
    kind of contact in the recordings. Its scores are calibrated probabilities, or raw where
    calibration was worse in both of two sessions. It classifies windows that differ from all
    training trials as *unknown*. Existing model files are only replaced with --force.
    """
    with refusals():
        check_paths(*recordings)
        from tactile_lab.commands.analysis.train import run_recalibrate, run_train
        from tactile_lab.commands.cluster import on_cluster

        if request.recalibrate is not None:
            run_recalibrate(
                request.recalibrate,
                recordings,
                request.folder,
                force=request.force,
                as_json=json_output,
            )
            return
        with on_cluster(cluster):
            run_train(recordings, request, as_json=json_output)


def robustness(
    report: Annotated[
        Path,
        typer.Option('--report', '-o', help='Report to write: a folder, or an HTML file.'),
    ],
    contact: Annotated[
        str, typer.Option(**choice('flexion', 'abduction'), help='How the finger touches.')
    ] = 'flexion',
    description: Annotated[
        Optional[Path],
        typer.Option(
            help='Folder with your own finger, rig, plates or objects: YAML files laid over '
            'those of the package.'
        ),
    ] = None,
    seed: SeedOption = 1,
    jobs: Annotated[
        int, typer.Option(help='How many processes simulate; -1: one for each core.')
    ] = -1,
    cluster: ClusterOption = '',
    json_output: JsonOption = False,
) -> None:
    """Find out on **simulated** trials how good sensor and rig must be.

    Noise, drift, lost samples, jitter, glide speed, contact depth and sample rate are made
    worse one at a time: accuracy of a model that was trained under good conditions, and of
    one that was trained under the bad ones. Takes about a minute at most.
    """
    with refusals():
        from tactile_lab.commands.analysis.robustness import run_robustness
        from tactile_lab.commands.cluster import on_cluster

        with on_cluster(cluster):
            run_robustness(
                report,
                contact=contact,
                description=description,
                seed=seed,
                jobs=jobs,
                as_json=json_output,
            )
