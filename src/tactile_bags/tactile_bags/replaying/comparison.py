# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bit-for-bit comparison of two passes over a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from tactile_bags.replaying.replay import TactileResults
from tactile_classifier.records import ClassificationResult
from tactile_features.records import FeatureWindow

TAIL_S = 1.0
"""Time before the end of a recording within which a completed result may be missing [s]."""

Result = FeatureWindow | ClassificationResult


@dataclass(frozen=True)
class Comparison:
    """Result of a bit-for-bit comparison of two passes over a recording.

    Attributes
    ----------
    first_difference : str
        One sentence on the first difference; empty when the passes are equal.
    window_count, classification_count : int
        Number of windows and classifications that were compared.
    left_out : str
        Sentences on results that were not compared; empty when there are none. They began before
        the recording, or lie at its interrupted end in one pass only.
    """

    first_difference: str
    window_count: int
    classification_count: int
    left_out: str = ''

    @property
    def is_equal(self) -> bool:
        return not self.first_difference


def compare_with_recorded(
    recorded: TactileResults, core: TactileResults, end_ns: int, begin_ns: int = 0
) -> Comparison:
    """Compare what was recorded with what the core makes of the recorded samples and events.

    At its end, a recording that is interrupted can lack what became complete just then, or the
    last samples of what was recorded. This tail is left out: it lies within `TAIL_S` of the end,
    and nothing of its kind comes after it. What lacks before it is a difference. Also left out is
    a phase that had begun when the recording did: its first samples are not there.

    Parameters
    ----------
    recorded, core : TactileResults
        With ``made_at_ns``.
    end_ns : int
        When the last message of the recording arrived [ns].
    begin_ns : int
        Time of the first sample of the recording [ns].
    """
    names = 'the recording', 'the core'
    whole = compare(recorded, core, names)
    if whole.is_equal:
        return whole
    begun = {
        (_kind(result), result.trial_id): result
        for result in (*core.all(), *recorded.all())
        if result.window_start_ns < begin_ns
    }
    one, other = (
        _without(results, [r for r in results.all() if (_kind(r), r.trial_id) in begun])
        for results in (recorded, core)
    )
    from_ns = end_ns - round(TAIL_S * 1e9)
    late = _tail(other, one, from_ns), _tail(one, other, from_ns)
    comparison = compare(_without(one, late[1]), _without(other, late[0]), names)
    if not comparison.is_equal:
        return whole
    return replace(comparison, left_out=_describe_left_out([*begun.values()], *late))


def _tail(more: TactileResults, fewer: TactileResults, from_ns: int) -> list[Result]:
    """Return what one pass has behind the last of another, by kind, if it is from the end."""
    found: list[Result] = []
    kinds = _by_kind(fewer)
    for kind, results in _by_kind(more).items():
        results.sort(key=lambda result: more.made_at_ns[id(result)])
        rest = results[len(kinds.get(kind, ())) :]
        if all(more.made_at_ns[id(result)] >= from_ns for result in rest):
            found += rest
    return found


def _by_kind(results: TactileResults) -> dict[tuple[object, ...], list[Result]]:
    """Return results by topic, and by specification or model."""
    kinds: dict[tuple[object, ...], list[Result]] = {}
    for result in results.all():
        kinds.setdefault(_kind(result), []).append(result)
    return kinds


def _kind(result: Result) -> tuple[object, ...]:
    if isinstance(result, FeatureWindow):
        return 'windows', result.specification_digest, result.partial
    return 'answers', result.model_id, result.partial


def _without(results: TactileResults, left_out: Sequence[Result]) -> TactileResults:
    gone = {id(result) for result in left_out}
    return TactileResults(
        [window for window in results.windows if id(window) not in gone],
        [answer for answer in results.classifications if id(answer) not in gone],
        results.made_at_ns,
    )


def _describe_left_out(
    begun: Sequence[Result], unrecorded: Sequence[Result], unfounded: Sequence[Result]
) -> str:
    sentences = []
    if begun:
        sentences.append(
            f'{_count(begun)} began before the recording, which lacks the first samples'
        )
    if unrecorded:
        sentences.append(
            f'{_count(unrecorded)} became complete within {TAIL_S:g} s before the recording was '
            'interrupted, and could not be recorded any more'
        )
    if unfounded:
        sentences.append(
            f'the last samples or events of {_count(unfounded)} could not be recorded any more'
        )
    return '; '.join(sentences)


def _count(results: Sequence[Result]) -> str:
    windows = sum(isinstance(result, FeatureWindow) for result in results)
    counts = {'feature windows': windows, 'classifications': len(results) - windows}
    trials = ', '.join(sorted({result.trial_id or '(none)' for result in results}))
    what = ' and '.join(f'{count} {name}' for name, count in counts.items() if count)
    return f'{what} of trial {trials}'


def compare(one: TactileResults, other: TactileResults, names: tuple[str, str]) -> Comparison:
    """Compare two passes: every feature, label, score and stamp.

    Parameters
    ----------
    one, other : TactileResults
    names : tuple of str
        What to call them in the sentence about a difference.
    """
    difference = _first_difference('feature windows', one.windows, other.windows, names)
    difference = difference or _first_difference(
        'classifications', one.classifications, other.classifications, names
    )
    return Comparison(difference, len(one.windows), len(one.classifications))


def _first_difference(
    what: str, one: Sequence[Any], other: Sequence[Any], names: tuple[str, str]
) -> str:
    for left, right in zip(one, other, strict=False):
        for item in fields(left):
            a, b = getattr(left, item.name), getattr(right, item.name)
            if not _same(a, b):
                return (
                    f'{what} of trial {left.trial_id or "(none)"}: {item.name} is '
                    f'{_short(a)} in {names[0]} and {_short(b)} in {names[1]}'
                )
    if len(one) != len(other):
        return f'{len(one)} {what} in {names[0]}, {len(other)} in {names[1]}'
    return ''


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
        return bool(a.shape == b.shape and a.tobytes() == b.tobytes())
    # The texts tell -0.0 from 0.0, and no other two numbers that are equal.
    return bool(a == b) and repr(a) == repr(b)


def _short(value: Any) -> str:
    text = repr(value.tolist() if isinstance(value, np.ndarray) else value)
    return text if len(text) <= 60 else text[:57] + '...'
