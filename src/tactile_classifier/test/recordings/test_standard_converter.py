# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Our graphs of neighbours and SVM beside those of skl2onnx, on public recordings.

Each is compared with the estimator that it was converted from: at the trials, and half way
between each two of them, where labels change first. Decision 0004 shows the counts. A failure
here because skl2onnx has become better is the reason to review it.
"""

from typing import NamedTuple

import numpy as np
import pytest
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline
from sklearn.svm import SVC

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from onnxruntime import InferenceSession
from skl2onnx import to_onnx
from skl2onnx.common.data_types import DoubleTensorType

from tactile_classifier.datasets.dataset import table_from_trials
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    compute_raw_scores,
    MAX_SVM_STEPS,
)
from tactile_classifier.model_file.graphs import add_neighbours, add_scaling, add_svm
from tactile_features.onnx_container import OPERATORS


@pytest.fixture(scope='module')
def tables(load_recording):
    return {
        'spectra': table_from_trials(
            'texture', load_recording('fabric_slide.npz').where('balanced')
        ),
        'stiffness': table_from_trials(
            'stiffness', load_recording('phac_hold.npz').between(1.0, 5.0)
        ),
    }


class Difference(NamedTuple):
    """Labels that differ from the estimator's, and the largest difference of a score."""

    trials: int
    midpoints: int
    score: float


def compare(estimator, table, step, compute):
    i, j = (indices[::step] for indices in np.triu_indices(len(table.values), 1))
    changed, differences = [], []
    for rows in (table.values, (table.values[i] + table.values[j]) / 2):
        # 64 at once, as a model does: the differences to all trials take memory.
        scores = np.concatenate([compute(rows[n : n + 64]) for n in range(0, len(rows), 64)])
        expected = compute_raw_scores(estimator, rows)
        changed.append(int((scores.argmax(axis=1) != expected.argmax(axis=1)).sum()))
        differences.append(float(np.abs(scores - expected).max()))
    return Difference(*changed, max(differences))


def compare_ours(open_graph, table, classifier, scaling, step=1):
    """Return what our graph changes."""
    estimator = build_estimator(classifier, scaling).fit(table.values, table.labels)
    add = add_neighbours if classifier == 'knn' else add_svm
    compute = open_graph(
        lambda graph, x: add(graph, estimator[-1], add_scaling(graph, estimator, x)),
        table.values.shape[1],
        len(estimator.classes_),
    )
    return compare(estimator, table, step, compute)


def compare_standard(table, classifier, scaling, step=1, optim=None):
    """Return what skl2onnx changes of scikit-learn's own estimator, and its operators."""
    if classifier == 'knn':
        last = KNeighborsClassifier(3)
        options = {KNeighborsClassifier: {'zipmap': False, 'optim': optim}}
    else:
        kernel = classifier.removeprefix('svm_')
        last = SVC(kernel=kernel, break_ties=True, max_iter=MAX_SVM_STEPS)
        options = {SVC: {'zipmap': False, 'raw_scores': True}}
    steps = build_estimator(classifier, scaling).steps[:-1]
    estimator = Pipeline([*steps, ('classify', last)]).fit(table.values, table.labels)
    model = to_onnx(
        estimator,
        initial_types=[('x', DoubleTensorType([None, table.values.shape[1]]))],
        options=options,
        target_opset={'': 18, 'ai.onnx.ml': 3},
    )
    session = InferenceSession(model.SerializeToString(), providers=['CPUExecutionProvider'])
    found = compare(estimator, table, step, lambda rows: session.run(None, {'x': rows})[1])
    return found, {f'{n.domain}:{n.op_type}'.removeprefix(':') for n in model.graph.node}


@pytest.mark.parametrize('scaling', ['none', 'standard'])
@pytest.mark.parametrize('classifier', ['knn', 'svm_linear', 'svm_rbf'])
@pytest.mark.parametrize('name', ['spectra', 'stiffness'])
def test_our_graphs_keep_every_label(tables, open_graph, name, classifier, scaling):
    found = compare_ours(open_graph, tables[name], classifier, scaling, step=17)
    assert found[:2] == (0, 0)
    # A linear kernel of values that are not scaled costs digits in scikit-learn as well.
    assert found.score < 1e-8


@pytest.mark.parametrize('optim', [None, 'cdist'])
def test_standard_neighbours_change_labels_and_need_operators_that_are_refused(tables, optim):
    found, operators = compare_standard(tables['spectra'], 'knn', 'none', 17, optim)
    assert found.midpoints > 0
    assert operators - OPERATORS >= {'com.microsoft:CDist' if optim else 'Scan'}


@pytest.mark.parametrize('classifier', ['svm_linear', 'svm_rbf'])
def test_standard_svm_computes_in_single_precision(tables, classifier):
    found, operators = compare_standard(tables['stiffness'], classifier, 'none', 17)
    assert found.score > 1e-8
    assert 'ai.onnx.ml:SVMClassifier' in operators
