# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Statements of the paper's text, and rules that compare the trials at hand with them.

Only numbers from the text are used; the figures of the paper have more. The paper does not say
whether features were scaled, so each rule is applied with and without scaling.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tactile_classifier.records import CLASSIFIERS, SCALINGS
from tactile_features.records import PROTOCOL_STIFFNESS, PROTOCOL_TEXTURE
from tactile_lab.report.analysis import SetResult
from tactile_lab.report.significance import find_components, LEVEL

PERFECT = 0.995
"""From here on an accuracy counts as the paper's 100 % [1]."""

STIFFNESS_LEAST = 0.972
DRAMATIC = 0.10
EQUALLY = 0.03
FEW = 0.10
HIGH = 0.95

LABELS = {
    PROTOCOL_TEXTURE: {'F', 'R1', 'R2', 'R3', 'T1', 'T2', 'C1', 'C2'},
    PROTOCOL_STIFFNESS: {'pla', 'solid_rubber', 'rubber_shell', 'sponge', 'none'},
}
"""The paper's labels by task. Its statements are about these and no others."""

AGREES = 'agrees'
DISAGREES = 'does not agree'
UNTESTED = 'not tested'


@dataclass(frozen=True)
class Comparison:
    """One statement of the paper beside what was measured.

    By the ``rule`` it agrees; the ``verdict`` is `AGREES`, `DISAGREES`, `UNTESTED`, or that it
    agrees for some sets only.
    """

    statement: str
    rule: str
    measured: str
    verdict: str


def is_the_papers(result: SetResult) -> bool:
    """Return whether the trials have the labels of the paper, all of them and no others."""
    table = result.recordings.table
    return set(map(str, table.labels)) == LABELS.get(table.task)


def lowest_published(result: SetResult, classifier: str) -> float | None:
    """Return what the text gives for a classifier on a task, or the bound; None: nothing."""
    task = result.recordings.table.task
    if not is_the_papers(result):
        return None
    if task == PROTOCOL_TEXTURE and classifier in ('knn', 'svm_rbf'):
        return 1.0
    if task == PROTOCOL_STIFFNESS and classifier in ('knn', 'svm_linear', 'tree'):
        return STIFFNESS_LEAST
    return None


def format_design(results: Sequence[SetResult]) -> str:
    """Return how the trials were made beside how we read that the paper's were.

    The paper tells of 60 trials on each plate, and neither of sessions nor of mountings.
    """
    told = {}
    for result in results:
        table = result.recordings.table
        sessions, mountings = map(table.columns.get, ('session_id', 'mounting_id'))
        if sessions is None or mountings is None or (np.asarray(mountings) == '').any():
            told[result.name] = 'sessions or mountings not stated'
            continue
        most = max(len(set(mountings[table.labels == label])) for label in set(table.labels))
        count = len(set(sessions))
        as_read = count == 1 and most == 1
        told[result.name] = (
            f'{count} session{"s" if count > 1 else ""}, each plate or object fixed '
            f'{"once" if most == 1 else f"up to {most} times"}, '
            f'{"as" if as_read else "not as"} in the paper'
        )
    same = set(told.values())
    words = same.pop() if len(same) == 1 else '; '.join(f'{k}: {v}' for k, v in told.items())
    return (
        'The paper is read as one session in which each plate or object was fixed once: it tells '
        f'of no other. These trials: {words}.'
    )


def compare_with_paper(results: Sequence[SetResult]) -> list[Comparison]:
    """Return the paper's statements on its own two tasks, each with a verdict."""
    textures = [r for r in results if r.recordings.table.task == PROTOCOL_TEXTURE]
    holds = [r for r in results if r.recordings.table.task == PROTOCOL_STIFFNESS]
    claims: Sequence[tuple[str, str, Sequence[SetResult], Sequence[str], Callable[..., bool]]] = (
        (
            'Texture: neighbours and the RBF SVM reach 100 %',
            f'all means at least {100 * PERFECT:.1f} %',
            textures,
            ('knn', 'svm_rbf'),
            lambda *means: min(means) >= PERFECT,
        ),
        (
            'Texture: the tree stably reaches high accuracy',
            f'mean at least {100 * HIGH:.0f} %',
            textures,
            ('tree',),
            lambda mean: mean >= HIGH,
        ),
        (
            'Texture: the SVM depends on its kernel; the linear one is lower',
            f'linear {100 * EQUALLY:.0f} points or more below RBF',
            textures,
            ('svm_linear', 'svm_rbf'),
            lambda linear, rbf: rbf - linear >= EQUALLY,
        ),
        (
            'Stiffness: neighbours, the linear SVM and the tree reach above 97.2 %',
            'all means at least 97.2 %',
            holds,
            ('knn', 'svm_linear', 'tree'),
            lambda *means: min(means) >= STIFFNESS_LEAST,
        ),
        (
            'Stiffness: the RBF SVM is dramatically lower',
            f'{100 * DRAMATIC:.0f} points or more below each of the others',
            holds,
            CLASSIFIERS,
            lambda knn, linear, rbf, tree: min(knn, linear, tree) - rbf >= DRAMATIC,
        ),
    )
    rows = []
    for statement, rule, sets, shown, agrees in claims:
        for scaling, words in zip(SCALINGS, ('scaled', 'not scaled'), strict=True):
            found = []
            for result in sets:
                means = [result.plain.score(name, scaling).mean for name in shown]
                found.append((result, _format_means(shown, means), agrees(*means)))
            rows.append(_compare(f'{statement} ({words})', rule, found))
    rows += [_compare_contacts('Texture', textures), _compare_contacts('Stiffness', holds)]
    shares = [(r, share) for r in textures if (share := _share_above(r)) is not None]
    rows.append(
        _compare(
            'Besides 0 Hz, only few Fourier components have a mean p above 0.05',
            f'{100 * FEW:.0f} % of them at most',
            [(result, f'{100 * share:.0f} %', share <= FEW) for result, share in shares],
        )
    )
    counts = [(result, _count_unlike_paper(result)) for result in holds]
    rows.append(
        _compare(
            'The three stiffness features differ between all objects, except the correlation '
            'between rubber and PLA',
            'p over 0.05 for no other pair',
            [(result, f'{count} other pairs', not count) for result, count in counts],
        )
    )
    return rows


def _compare(
    statement: str, rule: str, found: Sequence[tuple[SetResult, str, bool]]
) -> Comparison:
    """Compare with what was measured on each set, in words, and whether that agrees."""
    if not found:
        return Comparison(statement, rule, 'no such trials', UNTESTED)
    measured = '; '.join(f'{result.name}: {words}' for result, words, _ in found)
    agreeing = [result.name for result, _, agrees in found if agrees]
    if len(agreeing) == len(found):
        return Comparison(statement, rule, measured, AGREES)
    verdict = f'{AGREES} for {", ".join(agreeing)} only' if agreeing else DISAGREES
    return Comparison(statement, rule, measured, verdict)


def _compare_contacts(name: str, results: Sequence[SetResult]) -> Comparison:
    statement = f'{name}: flexion and abduction do equally well'
    rule = f'best classifiers within {100 * EQUALLY:.0f} points'
    best = {
        r.recordings.contact: max(score.mean for score in r.plain.scores)
        for r in results
        if r.recordings.contact
    }
    if len(best) < 2:
        return Comparison(statement, rule, 'one contact only', UNTESTED)
    measured = '; '.join(f'{contact}: {100 * mean:.1f} %' for contact, mean in best.items())
    equal = max(best.values()) - min(best.values()) <= EQUALLY
    return Comparison(statement, rule, measured, AGREES if equal else DISAGREES)


def _format_means(classifiers: Sequence[str], means: Sequence[float]) -> str:
    short = {'knn': 'neighbours', 'svm_linear': 'linear', 'svm_rbf': 'RBF', 'tree': 'tree'}
    return ', '.join(
        f'{short[name]} {100 * mean:.1f}' for name, mean in zip(classifiers, means, strict=True)
    )


def _share_above(result: SetResult) -> float | None:
    components = find_components(result.recordings.table.spec)
    if components is None:
        return None
    return float((result.significance.mean_p[components.columns] > LEVEL).mean())


def _count_unlike_paper(result: SetResult) -> int:
    """Return for how many features and pairs of classes p is not small; the paper excuses some."""
    significance = result.significance
    count = 0
    for name, p in zip(result.recordings.table.spec.names, significance.p, strict=True):
        for i, j in zip(*np.tril_indices(len(p), -1), strict=True):
            pair = (significance.labels[i].lower(), significance.labels[j].lower())
            rubber_and_pla = 'pla' in pair and 'rubber' in ''.join(pair)
            excused = name.endswith('correlation') and rubber_and_pla
            count += bool(p[i, j] > LEVEL and not excused)
    return count
