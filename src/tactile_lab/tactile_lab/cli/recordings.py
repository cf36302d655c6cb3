# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands on recordings and models; the work is in `tactile_lab.commands`."""

from tactile_lab.cli.request_options import spread
from tactile_lab.commands.analysis.requests import (
    CompareRequest,
    EvaluateRequest,
    FeaturesRequest,
    TrainRequest,
)
from tactile_lab.options import (
    check_paths,
    ClusterOption,
    JsonOption,
    RecordingsArgument,
)


@spread
def features(request: FeaturesRequest, as_json: JsonOption = False) -> None:
    """Write the features of recordings as a table, for notebooks and other programs.

    One row a trial: source, trial, label, session, group, simulated, then one column a feature.
    The units are in the metadata of each Parquet column, and in the names of CSV columns. With
    several tasks or contacts, each has its own file, with its name at the end.
    """
    check_paths(*request.recordings)
    from tactile_lab.commands.analysis.feature_file import run_features

    run_features(request, as_json=as_json)


@spread
def train(
    recordings: RecordingsArgument,
    request: TrainRequest,
    cluster: ClusterOption = '',
    as_json: JsonOption = False,
) -> None:
    """Fit the four classifiers, cross-validate them, write a model file.

    Prints the accuracy of six-fold cross-validation, repeated ten times, for all four
    classifiers with and without scaling. One ONNX file is written for each task and
    kind of contact in the recordings. Its scores are calibrated probabilities, or raw where
    calibration was worse in both of two sessions. It classifies windows that differ from all
    training trials as *unknown*. Existing model files are only replaced with --force.
    """
    check_paths(*recordings)
    from tactile_lab.commands.analysis.train import run_recalibrate, run_train
    from tactile_lab.commands.cluster import on_cluster

    if request.recalibrate is not None:
        run_recalibrate(
            request.recalibrate, recordings, request.folder, force=request.force, as_json=as_json
        )
        return
    with on_cluster(cluster):
        run_train(recordings, request, as_json=as_json)


@spread
def evaluate(
    request: EvaluateRequest, cluster: ClusterOption = '', as_json: JsonOption = False
) -> None:
    """Cross-validate the four classifiers on recordings, and write a report.

    Takes real or simulated trials and computes the same features as the live node. Evaluates
    every classifier with and without scaling, by random folds and by held-out groups such as
    sessions, and states the split beside each number. ``--report`` and ``--json`` add feature
    selection, and take longer. The report has the paper's figures, made of your trials.
    """
    check_paths(*request.recordings)
    from tactile_lab.commands.analysis.evaluate import run_evaluate
    from tactile_lab.commands.cluster import on_cluster

    with on_cluster(cluster):
        run_evaluate(request, as_json=as_json)


@spread
def compare(request: CompareRequest, as_json: JsonOption = False) -> None:
    """Say which of two models is better, and whether the difference is more than chance.

    As in: tactile compare old/texture_flexion.onnx new/texture_flexion.onnx bags/new_session

    Each model classifies every trial with its own features. "unknown" counts as wrong. The
    difference of the accuracies has a paired 95 % interval: Student's t over the sessions, each of
    which counts once, or with one session Tango's score interval over the trials. The table also
    shows rejected trials and file sizes. Below it are the confusions in which the models differ
    most, and the time of one classification by B against that by A.

    Use trials that neither model was trained on. The command warns of others: most model files
    state which trials they were trained on. Two folders of models are compared file by file, for
    each task and contact.
    """
    check_paths(request.model_a, request.model_b, *request.recordings)
    from tactile_lab.commands.analysis.compare import run_compare

    run_compare(request, as_json=as_json)
