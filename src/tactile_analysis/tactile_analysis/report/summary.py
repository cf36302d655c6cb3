# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Summary of one set of trials: sentences about accuracy, calibration and unknown objects.

The accuracy is that of the model that `tactile train` would write. It is measured on trials that
were not used to choose features and classifier.
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

from tactile_analysis.report.analysis import CLASSIFIER, SetResult
from tactile_analysis.trial_set import TrialSet
from tactile_analysis.wording import format_nested, format_span, name_candidate
from tactile_bags.recorded_bag import RecordedBag
from tactile_classifier.datasets.dataset import plain_name
from tactile_classifier.estimators.classifiers import default_scaling
from tactile_classifier.evaluation.cross_validation import Evaluation, Score
from tactile_classifier.evaluation.intervals import Interval
from tactile_classifier.evaluation.learning_curve import LearningCurve
from tactile_classifier.evaluation.open_set import OpenSetEvaluation
from tactile_classifier.evaluation.reliability import Reliability
from tactile_classifier.types import CLASSIFIER_TITLES, short_scaling

SESSION = ('session_id',)
"""Value of `Chosen.columns` if the automatic choice has held out whole sessions."""

LIBRARIES = ('tactile_classifier', 'numpy', 'scipy', 'scikit-learn', 'matplotlib')


@dataclass(frozen=True)
class Source:
    """One recording: the name of its file or folder, and the SHA-256 digest of its data files.

    ``facts`` are entries of its metadata, such as the seed of the simulation. ``corrections`` are
    sentences about trials that the journal of an experiment relabels or excludes.
    """

    name: str
    sha256: str
    facts: dict[str, Any]
    corrections: tuple[str, ...] = ()


def describe_sources(paths: Sequence[Path], recording: TrialSet) -> list[Source]:
    """Return the sources of a report: each bag with trial events, or else each path.

    ``recording`` is the open recording at ``paths``. If a path is a folder of files, the folder is
    one source.
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


def _format_corrections(bag: RecordedBag, recording: TrialSet) -> Iterator[str]:
    for trial in recording.trials:
        correction = bag.corrections.get(trial.name)
        if correction is None or trial.source != str(bag.path):
            continue
        if correction.label:
            yield f'{trial.name} was relabelled {correction.label}'
        if correction.why_not:
            yield f'{trial.name} is excluded: {correction.why_not.removeprefix("excluded: ")}'


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
    """Return the versions of Python, and of the libraries that affect the results."""
    found = {'python': platform.python_version()}
    for name in LIBRARIES:
        with suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


def usual_score(result: SetResult, evaluation: Evaluation) -> Score:
    """Return the score of `CLASSIFIER`, which is compared over all splits."""
    return evaluation.score(CLASSIFIER, default_scaling(result.recordings.table.task, CLASSIFIER))


def format_classifier(each: Score | OpenSetEvaluation | LearningCurve | Reliability) -> str:
    """Return the names of classifier and scaling, as text."""
    return f'{CLASSIFIER_TITLES[each.classifier]}, {short_scaling(each.scaling)}'


def format_model(result: SetResult) -> str:
    """Return features, classifier and scaling of the chosen model, as a sentence."""
    chosen = result.recordings.choice
    assert chosen is not None
    return f'Model: {name_candidate(chosen.choice.chosen)}, as chosen by tactile train.'


def format_first_sentence(result: SetResult) -> str:
    """Return the accuracy as a sentence, with number of trials, interval and chance level."""
    chosen = result.recordings.choice
    assert chosen is not None
    limit = ''
    if result.stated is not None:
        whose = 'the stated test trials'
    elif not chosen.columns:
        whose = 'the trials'
        limit = (
            ' The folds are random: the model was trained on other trials of the same '
            'recordings, so this accuracy does not predict the accuracy in a new session.'
        )
    elif chosen.columns == SESSION:
        whose = 'the trials of a new session'
    elif chosen.columns == ('trial_block',):
        whose = 'the trials of another part of the same session'
        limit = ' This accuracy does not predict the accuracy in a new session.'
    else:
        names = ' and '.join(map(plain_name, chosen.columns))
        whose = f'the trials of a new {names}'
    share = format_percent(result.headline.mean)
    return f'{share} of {whose} are classified correctly ({format_evidence(result)}).{limit}'


def format_evidence(result: SetResult) -> str:
    """Return number of trials, confidence interval and chance level of the accuracy, as text."""
    score = result.headline
    trials = f'{result.tested} trials'
    if score.spread_of == 'groups':
        is_session = result.recordings.choice and result.recordings.choice.columns == SESSION
        trials += f' of {score.fold_accuracies.size} {"sessions" if is_session else "groups"}'
    return f'{trials}; {format_span(score.interval)}; chance {format_percent(result.chance)}'


def format_learning_curve(result: SetResult) -> str | None:
    """Return a sentence on whether more sessions (or other groups) would improve the accuracy.

    Return None if there is no learning curve.
    """
    if (curve := result.curve) is None:
        return None
    first = next(point for point in curve.points if point.groups == curve.half)
    last = curve.points[-1]
    interval = curve.gain_interval
    span = 'the same for all groups'
    if not interval.reason:
        span = f'95 % interval {100 * interval.low:+.1f} to {100 * interval.high:+.1f}'
    return (
        f'Learning curve: {format_percent(first.mean)} with {first.groups} training '
        f'{"group" if first.groups == 1 else "groups"} ({curve.group}), '
        f'{format_percent(last.mean)} with {last.groups} ({100 * curve.gain:+.1f} points, '
        f'{span}). {_MORE[curve.needs_more]}'
    )


_MORE = {
    True: 'Record more: accuracy still increases.',
    False: 'More recordings of this kind would change little: accuracy no longer increases.',
    None: 'These trials cannot show whether more recordings would help.',
}


def format_reliability(result: SetResult) -> str | None:
    """Return the calibration error of the probabilities of held-out trials; None if unknown."""
    if (found := result.reliability) is None:
        return None
    return (
        f'Expected calibration error of the probabilities {format_percent(found.error)} '
        f'({found.trials} trials, {found.split}); perfectly calibrated probabilities would have '
        f'{format_percent(found.chance_error)} on average'
    )


def format_percent(share: float) -> str:
    """Return a fraction in %. A fraction just below 1 is ``> 99.9 %``, not ``100.0 %``."""
    rounded = f'{100 * share:.1f}'
    return '> 99.9 %' if rounded == '100.0' and share < 1.0 else f'{rounded} %'


def format_accuracy(result: SetResult) -> str:
    """Return accuracy, split, interval, baselines and most frequent confusion, in one line."""
    chosen, score = result.recordings.choice, result.headline
    assert chosen is not None
    if result.stated is None:
        accuracy = format_nested(chosen.choice)
    else:
        accuracy = (
            f'accuracy {100 * score.mean:.1f} % ({score.split}; {format_span(score.interval)}; '
            f'chosen on the training trials only); chance {100 * result.stated.chance:.1f} %'
        )
    parts = [accuracy, f'balanced accuracy {100 * score.balanced_accuracy:.1f} %']
    if refused := result.recordings.table.refused:
        parts.append(
            f'accuracy if the {refused} trials without features count as wrong: '
            f'{100 * result.end_to_end:.1f} %'
        )
    if (permuted := result.permuted) is not None:
        parts.append(
            f'accuracy with permuted labels: {100 * permuted.mean:.1f} % on average, '
            f'{100 * permuted.largest:.1f} % at most, in {permuted.permutations} permutations '
            f'(p = {permuted.p_value:.2g})'
        )
    return '; '.join((*parts, f'most frequent confusion: {format_confusion(score)}'))


def format_method(interval: Interval) -> str:
    """Return an interval in % with its method, or the reason why there is no interval."""
    span = format_span(interval)
    return span if interval.reason else f'{span} ({interval.method})'


def confusion_shares(score: Score) -> NDArray[np.float64]:
    """Return the confusion matrix, divided by the number of trials of each true label."""
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


def unknown_rows(found: OpenSetEvaluation) -> list[tuple[str, str]]:
    """Return the results on unknown objects and on calibration as rows of a table."""
    return [
        ('unknown objects, split', found.split),
        ('AUROC', f'{100 * found.auroc:.1f} %'),
        ('AUROC, interval', format_method(found.auroc_interval)),
        ('unknown objects missed', f'{100 * found.miss_rate:.1f} %'),
        (
            f'false rejection, stated rate {100 * found.false_alarm_rate:g} %',
            f'{100 * found.realised_false_alarm_rate:.1f} %',
        ),
        ('calibration error before', f'{100 * found.calibration_error_before:.1f} %'),
        ('calibration error after', f'{100 * found.calibration_error_after:.1f} %'),
    ]
