# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Results as tables for a terminal."""

from __future__ import annotations

from rich.table import Table

from tactile_classifier.evaluation import Evaluation

CLASSIFIER_TITLES = {
    'knn': '3 nearest neighbours',
    'svm_linear': 'SVM, linear kernel',
    'svm_rbf': 'SVM, RBF kernel',
    'tree': 'decision tree',
}

SCALING_TITLES = {
    'standard': 'scaled (zero mean, unit variance)',
    'none': 'not scaled',
}


def accuracy_table(evaluation: Evaluation, title: str) -> Table:
    """Return accuracies [%] by classifier and scaling, with their spread."""
    scalings = list(dict.fromkeys(score.scaling for score in evaluation.scores))
    table = Table(title=title, title_justify='left', title_style='bold')
    table.add_column('classifier')
    for scaling in scalings:
        table.add_column(SCALING_TITLES[scaling], justify='right')
    for classifier in dict.fromkeys(score.classifier for score in evaluation.scores):
        cells = []
        for scaling in scalings:
            score = evaluation.score(classifier, scaling)
            cells.append(f'{100 * score.mean:.1f} ± {100 * score.spread:.1f}')
        table.add_row(CLASSIFIER_TITLES[classifier], *cells)
    return table


def accuracy_caption(evaluation: Evaluation) -> str:
    """Return what the numbers of `accuracy_table` are."""
    return (
        f'accuracy in %: {evaluation.split}, {evaluation.trials} trials; '
        f'± standard deviation over {evaluation.scores[0].spread_of}; '
        f'chance {100 * evaluation.chance:.1f}'
    )
