# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile classify`: classify the trials of new recordings."""

from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from tactile_analysis.options import SourceOptions, TrialOptions
from tactile_lab import options
from tactile_lab.console import Cell, Prose, Table
from tactile_lab.output import Output
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_analysis.datasets.classified import ClassifiedTrial


def classify(
    recordings: options.RecordingsArgument,
    model: Annotated[
        Path,
        typer.Option(
            '--model',
            '-m',
            exists=True,
            help='Model file (.npz) of `tactile train`, or a folder of such files. Recordings of '
            'other software contain neither task nor contact, so they need a single file.',
        ),
    ],
    archives: TrialOptions = options.TRIALS,
    statements: SourceOptions = options.SOURCES,
    as_json: options.JsonOption = False,
) -> None:
    """Classify the trials of recordings with a model file.

    Example: tactile classify new.csv --model models/texture.npz

    Prints one line for each trial: the name of the trial, its label in the recording (if there is
    one), the predicted label with its probability, and the p-value, which is the fraction of
    held-out training trials that are at least as novel. If the trial differs from all training
    trials, the prediction is *unknown*. If it cannot be classified, the prediction is *no answer*,
    with the reason. The trials need no labels.

    Bags with trial events use the same features as the live node. In a table, an archive or a
    bag of other software, each trial is one window. A longer trial is cut as in training:
    ``--crop`` is applied first; then the samples of one window are taken from the start, or from
    the position at which the live node takes them. Rate, unit and channel must match the model;
    ``--resample-hz`` changes the rate, and the model contains the name of its channel.

    ``--json`` prints every probability and score. The command exits with 2 when no trial can be
    classified.
    """
    from tactile_analysis.datasets.classified import classify_recording, count_right
    from tactile_analysis.datasets.feature_options import FeatureOptions
    from tactile_analysis.trial_set import TrialSet

    output = Output(as_json)
    with (
        output.progress('classifying'),
        TrialSet.load(recordings, statements) as recording,
    ):
        found = classify_recording(recording, model, FeatureOptions(**vars(archives)))
    output.say(*found.notes)
    if not any(each.answer.scores for each in found.trials):
        reason = (
            found.trials[0].answer.reason
            if found.trials
            else 'there is no trial of the task and contact of a model'
        )
        raise TactileError(f'no trial can be classified: {reason}')
    output.say(_table(found.trials))
    right, known = count_right(found.trials)
    if known:
        output.say(f'{right} of {known} predictions match the label in the recording')
    output.result(
        {
            'trials': [each.to_dict() for each in found.trials],
            'notes': list(found.notes),
            'right': right,
            'with_known_label': known,
        }
    )


def _table(trials: 'tuple[ClassifiedTrial, ...]') -> Table:
    has_labels = any(each.label for each in trials)
    has_reasons = any(each.answer.reason for each in trials)
    models = {each.model.model_id for each in trials}
    names = [
        'trial',
        *(['label'] if has_labels else []),
        'answer',
        'probability',
        'p-value',
        *(['model'] if len(models) > 1 else []),
        *(['reason'] if has_reasons else []),
    ]
    table = Table(*names, spare=['model', 'p-value'])
    for each in trials:
        answer = each.answer
        probability = answer.probabilities.get(answer.label)
        cells: dict[str, Cell] = {
            'trial': each.trial,
            'label': each.label,
            'answer': answer.label,
            'probability': '' if probability is None else f'{probability:.3f}',
            'p-value': '' if answer.p_value is None else f'{answer.p_value:.3f}',
            'model': each.model.model_id,
            'reason': Prose(answer.reason or ''),
        }
        table.add_row(*(cells[name] for name in names))
    return table
