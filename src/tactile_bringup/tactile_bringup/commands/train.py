# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""`tactile train`: bags in, table of accuracies and model files out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactile_bringup.bag_tables import BagTables, read_tables
from tactile_bringup.commands.evaluate import evaluate_with_progress
from tactile_bringup.commands.output import Output, make_output_folder
from tactile_bringup.model_folder import model_path
from tactile_bringup.tables import (
    CLASSIFIER_TITLES,
    SCALING_TITLES,
    accuracy_caption,
    accuracy_table,
)
from tactile_classifier.dataset import FeatureTable
from tactile_classifier.estimators import DEFAULT_SCALING
from tactile_classifier.evaluation import Evaluation
from tactile_classifier.model_file import write_model
from tactile_classifier.training import train


@dataclass(frozen=True)
class TrainedModel:
    """One model file, the accuracies beside it, and the table that it came from."""

    path: Path
    model_id: str
    table: FeatureTable
    evaluation: Evaluation

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold."""
        return {
            'path': str(self.path),
            'model_id': self.model_id,
            'evaluation': self.evaluation.to_dict(),
        }


def run_train(
    bags: Sequence[Path],
    folder: Path,
    *,
    classifier: str,
    scaling: str | None,
    cross_validation: Mapping[str, int],
    as_json: bool,
) -> None:
    """Train on bags and print what came out."""
    output = Output(as_json)
    trained = train_models(
        read_with_progress(bags, output),
        folder,
        output,
        classifier=classifier,
        scaling=scaling,
        cross_validation=cross_validation,
    )
    output.result({'models': [model.to_dict() for model in trained]})


def read_with_progress(bags: Sequence[Path], output: Output) -> BagTables:
    """Read the bags' feature tables; say which trials are left out."""
    with output.progress() as progress:
        progress.add_task('extracting features', total=None)
        found = read_tables(bags)
    for sentence in found.left_out[:5]:
        output.say(f'left out: {sentence}')
    if len(found.left_out) > 5:
        output.say(f'left out: {len(found.left_out) - 5} more')
    return found


def train_models(
    found: BagTables,
    folder: Path,
    output: Output,
    *,
    classifier: str,
    scaling: str | None,
    cross_validation: Mapping[str, int],
) -> list[TrainedModel]:
    """Cross-validate the four classifiers on each table and write the chosen one's model."""
    make_output_folder(folder)
    models = []
    for (task, contact), table in found.tables.items():
        evaluation = evaluate_with_progress(table, output, **cross_validation)
        simulated = ', SIMULATED trials' if table.column('simulated').any() else ''
        output.say(accuracy_table(evaluation, f'{task}, {contact}{simulated}'))
        output.say(accuracy_caption(evaluation))
        chosen = scaling or DEFAULT_SCALING[task]
        score = evaluation.score(classifier, chosen)
        trained = train(table, classifier, chosen, score=score)
        path = model_path(folder, task, contact)
        model = write_model(path, trained)
        output.say(
            f'{path}: {CLASSIFIER_TITLES[classifier]}, {SCALING_TITLES[chosen]}; '
            f'{model.model_id}\n'
        )
        models.append(TrainedModel(path, model.model_id, table, evaluation))
    return models
