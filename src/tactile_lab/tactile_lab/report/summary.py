# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The summary of one set of trials: its accuracy as a plain sentence, its answers in rows.

The accuracy is that of three nearest neighbours, which were not chosen by the accuracies that
are shown; or, with ``--features auto``, of the choice inside the folds.
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

from tactile_bags.recorded_bag import RecordedBag
from tactile_bags.recording import Recording
from tactile_classifier.datasets.dataset import plain_name
from tactile_classifier.estimators.classifiers import default_scaling
from tactile_classifier.evaluation.cross_validation import Evaluation, Score
from tactile_classifier.evaluation.open_set import OpenSetEvaluation
from tactile_classifier.records import CLASSIFIER_TITLES, short_scaling
from tactile_lab.datasets.tables import format_interval, format_nested, name_candidate
from tactile_lab.report.analysis import SetResult
from tactile_lab.report.answers import Answers, CLASSIFIER

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


_RANDOM = 'stratified '
"""Beginning of the names of random splits."""


def shown_score(result: SetResult, evaluation: Evaluation) -> Score:
    """Return the score of the chosen classifier, or else of three nearest neighbours."""
    if result.recordings.choice is not None:
        candidate, _ = result.recordings.choice
        return evaluation.score(candidate.classifier, candidate.scaling)
    return evaluation.score(CLASSIFIER, default_scaling(result.recordings.table.task, CLASSIFIER))


def hardest_evaluation(result: SetResult) -> Evaluation:
    """Return the held-out split in which that classifier does worst; of equals, the last.

    Random folds count only where there is no other split. Where features were chosen on stated
    trials to train on, it is the split that tests on the others: these did not choose.
    """
    if result.recordings.choice is not None and result.recordings.splits:
        return result.evaluations[-1]
    held_out = [each for each in result.evaluations if not each.split.startswith(_RANDOM)]
    return min(
        reversed(held_out or result.evaluations), key=lambda each: shown_score(result, each).mean
    )


def format_classifier(each: Score | OpenSetEvaluation) -> str:
    """Return classifier and scaling in words."""
    return f'{CLASSIFIER_TITLES[each.classifier]}, {short_scaling(each.scaling)}'


def format_model(result: SetResult) -> str:
    """Return the model of the first sentence, and the command that writes it."""
    if result.recordings.choice is not None:
        chosen = name_candidate(result.recordings.choice[0])
        return f'This model: {chosen}, as chosen by the folds.'
    score = shown_score(result, result.plain)
    return (
        f'This model: {format_classifier(score)}, as '
        f'from tactile train --classifier {score.classifier}. The default of tactile train '
        'chooses features and classifier; --features auto evaluates that choice.'
    )


def format_first_sentence(result: SetResult) -> str:
    """Return touches of 100 that are named right in a plain sentence, for the hardest split."""
    choice = result.recordings.choice
    if choice is not None and not result.recordings.splits:
        split, mean = choice[1].split, choice[1].nested_accuracy
    else:
        evaluation = hardest_evaluation(result)
        split, mean = evaluation.split, shown_score(result, evaluation).mean
    rounded = round(100 * mean)
    # 99.7 is not all of 100.
    count = 'more than 99' if rounded == 100 and mean < 1 else f'{rounded}'
    right = f'this model names {count} of 100 touches right'
    if split in (stated.name for stated in result.recordings.splits):
        return f'On the stated test trials, {right}.'
    if split.startswith(_RANDOM):
        return (
            f'By random folds, {right}. It was trained on other trials of the same recordings, '
            'so this is no forecast for a new session.'
        )
    columns = {
        f'one {" and ".join(map(plain_name, columns))} held out': columns
        for columns in (('session_id',), ('trial_block',), *result.recordings.hold_out)
    }[split]
    if columns == ('session_id',):
        return f'In a new session, {right}.'
    if columns == ('trial_block',):
        return (
            f'In another part of the same session, {right}. This is no forecast for a new session.'
        )
    return f'With a new {" and ".join(map(plain_name, columns))}, {right}.'


def format_accuracy(result: SetResult) -> str:
    """Return accuracy, split, interval, chance and the most frequent confusion in one line."""
    evaluation = hardest_evaluation(result)
    score = shown_score(result, evaluation)
    confusion = f'most frequent confusion: {format_confusion(score)}'
    chosen = ''
    if result.recordings.choice is not None:
        candidate, choice = result.recordings.choice
        chosen = f'{name_candidate(candidate)} was chosen'
        if not result.recordings.splits:
            return (
                f'{format_nested(choice)}; {chosen}, whose own accuracy is too high on average, '
                f'since these trials chose it; {confusion} ({score.split})'
            )
        chosen = f'; {chosen} on trials that are not tested'
    split = score.split if len(result.evaluations) > 1 else f'{score.split}, the only split'
    interval = (
        f'no interval: {score.interval.reason}'
        if score.interval.reason
        else f'95 % interval {format_interval(score.interval)} %'
    )
    return (
        f'accuracy {100 * score.mean:.1f} % ({split}; {interval}); '
        f'chance {100 * evaluation.chance:.1f} %{chosen}; {confusion}'
    )


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
