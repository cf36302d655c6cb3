# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The summary of one set of trials: its accuracy as a plain sentence, its answers in rows.

The accuracy is the one that a model of `tactile train` has on trials that did not choose it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
import hashlib
import importlib.metadata
from pathlib import Path
import platform
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.recording import Recording
from tactile_analysis.report.analysis import SetResult
from tactile_analysis.report.answers import Answers, CLASSIFIER
from tactile_analysis.wording import format_nested, format_span, name_candidate
from tactile_bags.recorded_bag import RecordedBag
from tactile_classifier.datasets.dataset import plain_name
from tactile_classifier.estimators.classifiers import default_scaling
from tactile_classifier.evaluation.cross_validation import Evaluation, Score
from tactile_classifier.evaluation.open_set import OpenSetEvaluation
from tactile_classifier.records import CLASSIFIER_TITLES, short_scaling

LIBRARIES = ('tactile_classifier', 'numpy', 'scipy', 'scikit-learn', 'matplotlib')


@dataclass(frozen=True)
class Source:
    """One recording: the name of its file or folder, and the digest of its data files.

    ``facts`` are its statements about itself, such as seed and simulator. ``corrections`` are
    sentences about trials that an experiment's journal relabels or leaves out.
    """

    name: str
    sha256: str
    facts: dict[str, Any]
    corrections: tuple[str, ...] = ()


def describe_sources(paths: Sequence[Path], recording: Recording) -> list[Source]:
    """Return name, digest and facts of each bag of ours, or else of each named path.

    ``recording`` is that of the paths, open. A folder of files is one source.
    """
    if not recording.is_own:
        return [Source(path.resolve().name, _compute_digest(path), {}) for path in paths]
    return [
        Source(
            bag.path.resolve().name,
            bag.sha256(),
            {k: v for k, v in bag.metadata.items() if not isinstance(v, (dict, list))},
            tuple(_format_corrections(bag, recording)),
        )
        for bag in recording.bags
    ]


def _format_corrections(bag: RecordedBag, recording: Recording) -> Iterator[str]:
    for trial in recording.trials:
        correction = bag.corrections.get(trial.name)
        if correction is None or trial.source != str(bag.path):
            continue
        if correction.label:
            yield f'{trial.name} was relabelled {correction.label}'
        if correction.why_not:
            yield f'{trial.name} does not count: {correction.why_not}'


def _compute_digest(path: Path) -> str:
    """Return the SHA-256 of a file, or of all files of a folder in the order of their names."""
    digest = hashlib.sha256()
    files = sorted(p for p in path.rglob('*') if p.is_file()) if path.is_dir() else [path]
    for file in files:
        with file.open('rb') as stream:
            while block := stream.read(2**20):
                digest.update(block)
    return digest.hexdigest()


def find_versions() -> dict[str, str]:
    """Return the versions of Python and the libraries that the numbers depend on."""
    found = {'python': platform.python_version()}
    for name in LIBRARIES:
        with suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


def usual_score(result: SetResult, evaluation: Evaluation) -> Score:
    """Return the score of three nearest neighbours, the same classifier for every split."""
    return evaluation.score(CLASSIFIER, default_scaling(result.recordings.table.task, CLASSIFIER))


def format_classifier(each: Score | OpenSetEvaluation) -> str:
    """Return classifier and scaling in words."""
    return f'{CLASSIFIER_TITLES[each.classifier]}, {short_scaling(each.scaling)}'


def format_model(result: SetResult) -> str:
    """Return the model of the first sentence."""
    chosen = result.recordings.choice
    assert chosen is not None
    return f'This model: {name_candidate(chosen.choice.chosen)}, as tactile train chooses it.'


def format_first_sentence(result: SetResult) -> str:
    """Return touches of 100 that such a model names right in a plain sentence."""
    chosen = result.recordings.choice
    assert chosen is not None
    mean = result.headline.mean
    rounded = round(100 * mean)
    # 99.7 is not all of 100.
    count = 'more than 99' if rounded == 100 and mean < 1 else f'{rounded}'
    right = f'this model names {count} of 100 touches right'
    if result.stated is not None:
        return f'On the stated test trials, {right}.'
    if not chosen.columns:
        return (
            f'By random folds, {right}. It was trained on other trials of the same recordings, '
            'so this is no forecast for a new session.'
        )
    if chosen.columns == ('session_id',):
        return f'In a new session, {right}.'
    if chosen.columns == ('trial_block',):
        return (
            f'In another part of the same session, {right}. This is no forecast for a new session.'
        )
    return f'With a new {" and ".join(map(plain_name, chosen.columns))}, {right}.'


def format_accuracy(result: SetResult) -> str:
    """Return the accuracy with its split, interval, baselines and confusion in one line."""
    chosen, score = result.recordings.choice, result.headline
    assert chosen is not None
    if result.stated is None:
        accuracy = format_nested(chosen.choice)
    else:
        accuracy = (
            f'accuracy {100 * score.mean:.1f} % ({score.split}; {format_span(score.interval)}; '
            f'chosen on trials that are not tested); chance {100 * result.stated.chance:.1f} %'
        )
    parts = [accuracy, f'balanced accuracy {100 * score.balanced_accuracy:.1f} %']
    if refused := result.recordings.refused:
        parts.append(
            f'with {refused} refused trials counted as wrong {100 * result.end_to_end:.1f} %'
        )
    if (permuted := result.permuted) is not None:
        parts.append(
            f'on permuted labels {100 * permuted.mean:.1f} %, and at most '
            f'{100 * permuted.largest:.1f} % in {permuted.permutations} permutations '
            f'(p = {permuted.p_value:.2g})'
        )
    return '; '.join((*parts, f'most frequent confusion: {format_confusion(score)}'))


def confusion_shares(score: Score) -> NDArray[np.float64]:
    """Return the confusion as shares of the trials of each true label."""
    return np.asarray(score.confusion / np.maximum(score.confusion.sum(axis=1, keepdims=True), 1))


def format_confusion(score: Score) -> str:
    """Return the most frequent confusion, such as ``pla as sponge in 33 % of its trials``."""
    shares = confusion_shares(score)
    shares *= 1 - np.eye(len(shares))
    if not shares.any():
        return 'none'
    true, said = np.unravel_index(int(np.argmax(shares)), shares.shape)
    return (
        f'{score.labels[true]} as {score.labels[said]} in {100 * shares[true, said]:.0f} % of '
        'its trials'
    )


def answer_rows(answers: Answers) -> list[tuple[str, str]]:
    """Return what became of unknown labels and probabilities, in rows."""
    rows = []
    if (unknown := answers.open_set) is not None:
        rows += [
            ('unknown labels, split', unknown.split),
            ('AUROC', f'{100 * unknown.auroc:.1f} %'),
            ('unknown labels missed', f'{100 * unknown.miss_rate:.1f} %'),
            (
                f'false rejection, {100 * unknown.false_alarm_rate:g} % asked for',
                f'{100 * unknown.realised_false_alarm_rate:.1f} %',
            ),
            ('calibration error before', f'{100 * unknown.calibration_error_before:.1f} %'),
            ('calibration error after', f'{100 * unknown.calibration_error_after:.1f} %'),
        ]
    return rows
