# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the paper's text states, and whether the trials at hand agree, by stated rules.

Its figures have more numbers than its text; only the text's are here. It does not say
whether features were scaled, so each rule is applied with and without scaling.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_classifier.estimators.classifiers import CLASSIFIERS, SCALINGS
from tactile_features.records import PROTOCOL_STIFFNESS, PROTOCOL_TEXTURE
from tactile_lab.report.analysis import SetResult
from tactile_lab.report.components import find_components

PERFECT = 0.995
"""From here on an accuracy counts as the paper's 100 % [1]."""

STIFFNESS_LEAST = 0.972
DRAMATIC = 0.10
EQUALLY = 0.03
FEW = 0.10
SIMILAR_LEVEL = 0.05

LABELS = {
    PROTOCOL_TEXTURE: {'F', 'R1', 'R2', 'R3', 'T1', 'T2', 'C1', 'C2'},
    PROTOCOL_STIFFNESS: {'pla', 'solid_rubber', 'rubber_shell', 'sponge', 'none'},
}
"""The paper's labels by task. Its statements are about these and no others."""

_DESIGN_COLUMNS = ('session_id', 'mounting_id')
_WITHOUT_RBF = ('knn', 'svm_linear', 'tree')

AGREES = 'agrees'
DISAGREES = 'does not agree'
UNTESTED = 'not tested'


@dataclass(frozen=True)
class Comparison:
    """One statement of the paper beside what was measured.

    Attributes
    ----------
    statement : str
    rule : str
        When the measurement counts as agreeing.
    measured : str
    verdict : str
        ``agrees``, ``does not agree`` or ``not tested``.
    """

    statement: str
    rule: str
    measured: str
    verdict: str

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as what JSON can hold."""
        return {
            'statement': self.statement,
            'rule': self.rule,
            'measured': self.measured,
            'verdict': self.verdict,
        }


@dataclass(frozen=True)
class _Claim:
    """A statement on accuracies: which are shown, and how they are judged."""

    task: str
    statement: str
    rule: str
    shown: tuple[str, ...]
    holds: Callable[[SetResult, str], bool]


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


def tell_design(results: Sequence[SetResult]) -> str:
    """Return how the trials were made beside how we read that the paper's were.

    The paper tells of 60 trials on each plate, and neither of sessions nor of mountings.
    """
    told = {}
    for result in results:
        table = result.recordings.table
        sessions, mountings = (table.columns.get(name) for name in _DESIGN_COLUMNS)
        if sessions is None or mountings is None or (np.asarray(mountings) == '').any():
            told[_name(result)] = 'sessions or mountings not stated'
            continue
        most = max(len(set(mountings[table.labels == label])) for label in set(table.labels))
        count = len(set(sessions))
        as_read = count == 1 and most == 1
        told[_name(result)] = (
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
    rows = []
    for claim in _CLAIMS:
        sets = textures if claim.task == PROTOCOL_TEXTURE else holds
        for scaling, words in zip(SCALINGS, ('scaled', 'not scaled'), strict=True):
            rows.append(_compare_claim(claim, sets, scaling, words))
    rows += [
        _compare_contacts(name, sets)
        for name, sets in (('Texture', textures), ('Stiffness', holds))
    ]
    rows.append(
        _compare(
            'Besides 0 Hz, only few Fourier components have a mean p above 0.05',
            f'{100 * FEW:.0f} % of them at most',
            [r for r in textures if find_components(r.recordings.table.spec)],
            lambda r: f'{100 * _share_above(r):.0f} %',
            lambda r: _share_above(r) <= FEW,
        )
    )
    rows.append(
        _compare(
            'The three stiffness features differ between all objects, except the correlation '
            'between rubber and PLA',
            'p over 0.05 for no other pair',
            holds,
            lambda r: f'{len(_unlike_paper(r))} other pairs',
            lambda r: not _unlike_paper(r),
        )
    )
    return rows


def _compare_claim(
    claim: _Claim, results: Sequence[SetResult], scaling: str, words: str
) -> Comparison:
    return _compare(
        f'{claim.statement} ({words})',
        claim.rule,
        results,
        lambda result: _accuracies(result, scaling, claim.shown),
        lambda result: claim.holds(result, scaling),
    )


def _compare(
    statement: str,
    rule: str,
    results: Sequence[SetResult],
    tell: Callable[[SetResult], str],
    holds: Callable[[SetResult], bool],
) -> Comparison:
    if not results:
        return Comparison(statement, rule, 'no such trials', UNTESTED)
    measured = '; '.join(f'{_name(result)}: {tell(result)}' for result in results)
    agreeing = [holds(result) for result in results]
    verdict = AGREES if all(agreeing) else DISAGREES
    if any(agreeing) and not all(agreeing):
        names = ', '.join(_name(r) for r, a in zip(results, agreeing, strict=True) if a)
        verdict = f'{AGREES} for {names} only'
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


def _name(result: SetResult) -> str:
    return result.recordings.contact or result.recordings.title


def _means(result: SetResult, scaling: str, classifiers: Sequence[str]) -> list[float]:
    return [result.plain.score(classifier, scaling).mean for classifier in classifiers]


def _accuracies(result: SetResult, scaling: str, classifiers: Sequence[str]) -> str:
    short = {'knn': 'neighbours', 'svm_linear': 'linear', 'svm_rbf': 'RBF', 'tree': 'tree'}
    return ', '.join(
        f'{short[classifier]} {100 * mean:.1f}'
        for classifier, mean in zip(classifiers, _means(result, scaling, classifiers), strict=True)
    )


def _rbf_deficit(result: SetResult, scaling: str) -> float:
    (rbf,) = _means(result, scaling, ('svm_rbf',))
    return min(_means(result, scaling, _WITHOUT_RBF)) - rbf


def _share_above(result: SetResult) -> float:
    components = find_components(result.recordings.table.spec)
    if components is None:
        return 0.0
    return float((result.significance.mean_p[components.columns] > SIMILAR_LEVEL).mean())


def _unlike_paper(result: SetResult) -> list[tuple[str, str, str]]:
    """Return feature and pair of classes of each p that the paper does not excuse."""
    significance = result.significance
    found = []
    for name, p in zip(result.recordings.table.spec.names, significance.p, strict=True):
        for i, one in enumerate(significance.labels):
            for j in range(i):
                other = significance.labels[j]
                rubber_and_pla = (
                    'pla' in (one.lower(), other.lower()) and 'rubber' in (one + other).lower()
                )
                excused = name.endswith('correlation') and rubber_and_pla
                if p[i, j] > SIMILAR_LEVEL and not excused:
                    found.append((name, other, one))
    return found


_CLAIMS = (
    _Claim(
        PROTOCOL_TEXTURE,
        'Texture: neighbours and the RBF SVM reach 100 %',
        f'all means at least {100 * PERFECT:.1f} %',
        ('knn', 'svm_rbf'),
        lambda result, scaling: min(_means(result, scaling, ('knn', 'svm_rbf'))) >= PERFECT,
    ),
    _Claim(
        PROTOCOL_STIFFNESS,
        'Stiffness: neighbours, the linear SVM and the tree reach above 97.2 %',
        'all means at least 97.2 %',
        _WITHOUT_RBF,
        lambda result, scaling: min(_means(result, scaling, _WITHOUT_RBF)) >= STIFFNESS_LEAST,
    ),
    _Claim(
        PROTOCOL_STIFFNESS,
        'Stiffness: the RBF SVM is dramatically lower',
        f'{100 * DRAMATIC:.0f} points or more below each of the others',
        CLASSIFIERS,
        lambda result, scaling: _rbf_deficit(result, scaling) >= DRAMATIC,
    ),
)
