# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arguments and help of the commands on recordings; the work is in `tactile_lab.commands`.

Ubuntu 24.04 has Typer 0.9, which refuses ``X | None`` and does not look into annotations
that are strings: so ``Optional[X]``, and no ``from __future__ import annotations`` here.
"""

from pathlib import Path
from typing import Annotated

import typer

from tactile_lab.cli.request_options import spread
from tactile_lab.commands.analysis.requests import (
    CompareRequest,
    EvaluateRequest,
    FeaturesRequest,
    RecordingsArgument,
)
from tactile_lab.datasets.sources.options import SkipBadOption, SourceOptions
from tactile_lab.options import check_paths, ClusterOption, JsonOption, refusals


@spread
def import_recordings(
    sources: RecordingsArgument,
    output: Annotated[
        Path, typer.Option('--output', '-o', help='Archive to write, ending in .npz.')
    ],
    yes: Annotated[
        bool,
        typer.Option('--yes', '-y', help='Accept likely choices instead of asking.'),
    ] = False,
    skip_bad: SkipBadOption = False,
    force: Annotated[bool, typer.Option('--force', help='Replace the archive.')] = False,
    *,
    options: SourceOptions,
    json_output: JsonOption = False,
) -> None:
    """Make one archive of recordings that other programs made.

    Prints how it understood each column, array or message. On a terminal it asks for missing
    information; elsewhere it fails and names the option. `train`, `evaluate`, `compare` and
    `features` take the archive, and the same recordings directly, with the same options.
    """
    with refusals():
        check_paths(*sources)
        from tactile_lab.commands.analysis.import_recordings import run_import

        run_import(
            sources,
            output,
            options,
            accepts_guesses=yes,
            skip_bad=skip_bad,
            force=force,
            as_json=json_output,
        )


@spread
def features(request: FeaturesRequest, json_output: JsonOption = False) -> None:
    """Write the features of recordings as a table, for notebooks and other programs.

    One row a trial: source, trial, label, session, group, simulated, then one column a feature.
    The units are in the metadata of each Parquet column, and in the names of CSV columns. With
    several tasks or contacts, each has its own file, with its name at the end.
    """
    with refusals():
        check_paths(*request.recordings)
        from tactile_lab.commands.analysis.feature_file import run_features

        run_features(request, as_json=json_output)


@spread
def evaluate(
    request: EvaluateRequest,
    cluster: ClusterOption = '',
    json_output: JsonOption = False,
) -> None:
    """Cross-validate the four classifiers on recordings, and write a report.

    Takes real or simulated trials and computes the same features as the live node. Evaluates
    every classifier with and without scaling, by random folds and by held-out groups such as
    sessions, and states the split beside each number. ``--report`` and ``--json`` add learning
    curves and feature selection, and take twice as long. The report has the paper's figures, made
    of your trials.
    """
    with refusals():
        check_paths(*request.recordings)
        from tactile_lab.commands.analysis.evaluate import run_evaluate
        from tactile_lab.commands.cluster import on_cluster

        with on_cluster(cluster):
            run_evaluate(request, as_json=json_output)


@spread
def compare(request: CompareRequest, json_output: JsonOption = False) -> None:
    """Say which of two models is better, and whether the difference is more than chance.

    As in: tactile compare old/texture_flexion.onnx new/texture_flexion.onnx bags/new_session

    Each model classifies every trial with its own features. "unknown" counts as wrong. The
    difference of the accuracies has a paired 95 % interval: Student's t over the sessions, or
    with one session that of McNemar's exact test over the trials. The table also shows rejected
    trials and file sizes. Below it are the confusions in which the models differ most, and the
    time of one classification by B against that by A.

    Use trials that neither model was trained on. The command warns of others: most model files
    state which trials they were trained on. Two folders of models are compared file by file, for
    each task and contact.
    """
    with refusals():
        check_paths(request.model_a, request.model_b, *request.recordings)
        from tactile_lab.commands.analysis.compare import run_compare

        run_compare(request, as_json=json_output)
