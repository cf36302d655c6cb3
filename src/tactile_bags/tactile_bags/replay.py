# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Replay of a recording without nodes, and comparison with the recorded results.

`replay_through_core` uses the same objects as the nodes, without a ROS graph.
`tactile_lab.replay_nodes` does the same with real nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
import math
from typing import Any

import numpy as np

from tactile_bags.bag_reader import BagMessage, TactileBag
from tactile_bags.message_records import read_records
from tactile_bags.recorded_setup import RecordedFeatures
from tactile_classifier.model_set import ModelSet
from tactile_classifier.types import WindowPrediction
from tactile_features.conversions import event_from_msg
from tactile_features.extraction.extractor import TrialFeatureExtractor
from tactile_features.spec import FeatureSpec
from tactile_features.types import (
    FeatureWindow,
    PHASE_ABORTED,
    PHASE_DONE,
    PHASES_STATED,
    TrialEvent,
)
from tactile_ros.errors import MessageError
from tactile_ros.topics import CLASSIFICATION, EVENT, FEATURES, STRAIN


@dataclass
class TactileResults:
    """Feature windows and classifications of one pass over a recording.

    ``made_at_ns`` maps the Python `id` of each result to the arrival time of the result, or of the
    message that completed it [ns]; empty if unknown.
    """

    windows: list[FeatureWindow] = field(default_factory=list)
    classifications: list[WindowPrediction] = field(default_factory=list)
    made_at_ns: dict[int, int] = field(default_factory=dict)

    def all(self) -> list[FeatureWindow | WindowPrediction]:
        """Return windows and classifications."""
        return [*self.windows, *self.classifications]

    def sort(self) -> TactileResults:
        """Sort the results by the end of their windows. The order does not depend on arrival."""
        self.windows.sort(
            key=lambda w: (w.window_end_ns, w.trial_id, w.feature_set, w.specification_digest)
        )
        self.classifications.sort(key=lambda c: (c.window_end_ns, c.trial_id, c.model_id))
        return self


def recorded_results(bag: TactileBag, namespace: str = '') -> TactileResults:
    """Return the features and classifications that were published while recording."""
    results = TactileResults()
    for message, window in read_records(bag.messages(FEATURES, namespace=namespace)):
        results.windows.append(window)
        results.made_at_ns[id(window)] = message.received_at_ns
    for message, answer in read_records(bag.messages(CLASSIFICATION, namespace=namespace)):
        results.classifications.append(answer)
        results.made_at_ns[id(answer)] = message.received_at_ns
    return results.sort()


def first_sample_ns(bag: TactileBag, namespace: str = '') -> int | None:
    """Return the time of the first recorded sample of a finger [ns], or None."""
    first = next(read_records(bag.messages(STRAIN, namespace=namespace)), None)
    return None if first is None else int(first[1].stamp_ns)


def sensed_messages(bag: TactileBag, namespace: str = '') -> Iterator[BagMessage]:
    """Yield samples and events in the order of their arrival, for processing by nodes.

    The topic of the events is latched, so a recording may begin with events from before its start.
    If their trial had already ended, these events are skipped, because the recording has no
    samples of the trial.
    """
    over = _trials_before(bag, namespace)
    for message in bag.messages(STRAIN, EVENT, namespace=namespace):
        if message.type_name != EVENT or not over or not over.pop(0):
            yield message


def _trials_before(bag: TactileBag, namespace: str) -> list[bool]:
    """Return, for each event before the first sample, True if its trial preceded the recording.

    A trial preceded the recording if it ended before the first sample, and its events arrived much
    faster than they were stamped (in less than half of the time). Latched events of past trials
    arrive in this way when the recorder subscribes.
    """
    begin_ns = first_sample_ns(bag, namespace)
    stamps_ns: dict[str, list[int]] = {}
    arrivals_ns: dict[str, list[int]] = {}
    trials, ended = [], set()
    for message in bag.messages(EVENT, namespace=namespace):
        try:
            event = event_from_msg(message.decode())
        except MessageError:
            break
        if begin_ns is None or event.stamp_ns >= begin_ns:
            break
        trials.append(event.trial_id)
        stamps_ns.setdefault(event.trial_id, []).append(event.stamp_ns)
        arrivals_ns.setdefault(event.trial_id, []).append(message.received_at_ns)
        if event.phase in (PHASE_DONE, PHASE_ABORTED):
            ended.add(event.trial_id)
    return [
        trial in ended and 2 * np.ptp(arrivals_ns[trial]) < np.ptp(stamps_ns[trial])
        for trial in trials
    ]


@dataclass
class ReplayedPhases:
    """Windows and phases that are computed from recorded samples and events.

    ``windows`` are in the order of their completion. ``made_at_ns`` is the same as in
    `TactileResults`. ``events`` are the recorded phases, or the phases that were detected in the
    tension.
    """

    windows: list[FeatureWindow] = field(default_factory=list)
    made_at_ns: dict[int, int] = field(default_factory=dict)
    events: list[TrialEvent] = field(default_factory=list)
    specifications: tuple[FeatureSpec, ...] = ()


def replay_phases(
    bag: TactileBag, features: RecordedFeatures, namespace: str = '', *, finish: bool = False
) -> ReplayedPhases:
    """Compute the windows and phases of a recording without nodes.

    If ``finish`` is True, windows that were incomplete at the end of the recording are also
    returned, as windows without features.
    """
    extractor = TrialFeatureExtractor(features.config, features.wanted)
    replayed = ReplayedPhases(specifications=extractor.specifications)
    arrived_ns = 0

    def take(windows: list[FeatureWindow]) -> None:
        replayed.windows += windows
        replayed.made_at_ns |= {id(window): arrived_ns for window in windows}

    for message, record in read_records(sensed_messages(bag, namespace)):
        arrived_ns = message.received_at_ns
        if message.type_name == STRAIN:
            take(extractor.add_block(record))
            replayed.events += extractor.take_detected_events()
        else:
            take(extractor.add_event(record))
            if features.config.phases == PHASES_STATED:
                replayed.events.append(record)
    arrived_ns = bag.end_ns
    take(extractor.pass_time(arrived_ns))
    if finish:
        take(extractor.finish())
    return replayed


def replay_through_core(
    bag: TactileBag,
    models: ModelSet | None,
    features: RecordedFeatures,
    namespace: str = '',
) -> TactileResults:
    """Compute the features and classifications of a finger without nodes."""
    replayed = replay_phases(bag, features, namespace)
    results = TactileResults(replayed.windows, made_at_ns=replayed.made_at_ns)
    if models is not None:
        models.set_specifications(replayed.specifications)
        for window in replayed.windows:
            answers = models.classify(window)
            results.classifications += answers
            at_ns = results.made_at_ns[id(window)]
            results.made_at_ns |= {id(answer): at_ns for answer in answers}
    return results.sort()


ROUNDING = 1e-9
"""If recorded and replayed numbers differ by at most this fraction, they count as equal."""

TAIL_S = 1.0
"""Time before the end of a recording in which results may be missing [s]."""

Result = FeatureWindow | WindowPrediction


@dataclass(frozen=True)
class ReplayComparison:
    """Result of the comparison of two passes over a recording.

    Attributes
    ----------
    first_difference : str or None
        A sentence about the first difference; None if the passes are equal.
    left_out : str or None
        Description of the results that were not compared, because they began before the recording,
        or because they are at the interrupted end of the recording and only in one pass.
    is_exact : bool
        True if all bits of the results are equal. If a recording is from another computer, results
        may differ by rounding, because sums in NumPy depend on the processor.
    """

    first_difference: str | None
    window_count: int
    classification_count: int
    left_out: str | None = None
    is_exact: bool = True

    @property
    def is_equal(self) -> bool:
        return self.first_difference is None


def compare_with_recorded(
    recorded: TactileResults, core: TactileResults, end_ns: int, begin_ns: int = 0
) -> ReplayComparison:
    """Compare recorded results with results that the core computes from samples and events.

    Numbers may differ by the relative error `ROUNDING`. The following results are not compared:

    - Results that began before the recording, because their first samples are missing.
    - Results at the end that are only in one of the two passes. If a recording was interrupted,
      its last results or the last samples of these results may be missing. A result belongs to the
      end if it became complete within `TAIL_S` before ``end_ns``, and no other result of the same
      kind follows it in the shorter pass. If a result is missing earlier, this is a difference.

    Parameters
    ----------
    end_ns : int
        Arrival time of the last message of the recording [ns].
    begin_ns : int
        Time of the first sample of the recording [ns].
    """
    names = 'the recording', 'the core'
    whole = compare(recorded, core, names, rounding=ROUNDING)
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
    kept = _without(one, late[1]), _without(other, late[0])
    comparison = compare(*kept, names, rounding=ROUNDING)
    if not comparison.is_equal:
        return whole
    return replace(comparison, left_out=_format_left_out([*begun.values()], *late))


def _tail(more: TactileResults, fewer: TactileResults, from_ns: int) -> list[Result]:
    """Return the results at the end of ``more`` that ``fewer`` does not have.

    If one of these results became complete before ``from_ns``, no results of its kind (see
    `_by_kind`) are returned.
    """
    found: list[Result] = []
    kinds = _by_kind(fewer)
    for kind, results in _by_kind(more).items():
        results.sort(key=lambda result: more.made_at_ns[id(result)])
        rest = results[len(kinds.get(kind, ())) :]
        if all(more.made_at_ns[id(result)] >= from_ns for result in rest):
            found += rest
    return found


def _by_kind(results: TactileResults) -> dict[tuple[object, ...], list[Result]]:
    """Return the results of each kind: windows by specification, classifications by model."""
    kinds: dict[tuple[object, ...], list[Result]] = {}
    for result in results.all():
        kinds.setdefault(_kind(result), []).append(result)
    return kinds


def _kind(result: Result) -> tuple[object, ...]:
    if isinstance(result, FeatureWindow):
        return 'windows', result.specification_digest
    return 'answers', result.model_id


def _without(results: TactileResults, left_out: Sequence[Result]) -> TactileResults:
    gone = {id(result) for result in left_out}
    return TactileResults(
        [window for window in results.windows if id(window) not in gone],
        [answer for answer in results.classifications if id(answer) not in gone],
        results.made_at_ns,
    )


def _format_left_out(
    begun: Sequence[Result], unrecorded: Sequence[Result], unfounded: Sequence[Result]
) -> str | None:
    sentences = []
    if begun:
        sentences.append(
            f'{_count(begun)} began before the recording, so their first samples are missing'
        )
    if unrecorded:
        sentences.append(
            f'{_count(unrecorded)} became complete within {TAIL_S:g} s before the recording was '
            'interrupted, and could not be recorded'
        )
    if unfounded:
        sentences.append(
            f'the last samples or events of {_count(unfounded)} could not be recorded'
        )
    return '; '.join(sentences) or None


def _count(results: Sequence[Result]) -> str:
    windows = sum(isinstance(result, FeatureWindow) for result in results)
    counts = {'feature windows': windows, 'classifications': len(results) - windows}
    trials = ', '.join(sorted({result.trial_id or '(none)' for result in results}))
    what = ' and '.join(f'{count} {name}' for name, count in counts.items() if count)
    return f'{what} of trial {trials}'


def compare(
    one: TactileResults, other: TactileResults, names: tuple[str, str], *, rounding: float = 0.0
) -> ReplayComparison:
    """Compare every feature, label, score and stamp of two passes.

    ``names`` are the names of the passes in messages. Numbers may differ by the relative error
    ``rounding``. Values of an array may differ by this fraction of the largest value in the array.
    """
    kinds: tuple[tuple[str, Sequence[Any], Sequence[Any]], ...] = (
        ('feature windows', one.windows, other.windows),
        ('classifications', one.classifications, other.classifications),
    )

    def find_difference(share: float) -> str | None:
        found = (_first_difference(what, a, b, names, share) for what, a, b in kinds)
        return next(filter(None, found), None)

    difference = find_difference(0.0)
    is_exact = difference is None
    if rounding and not is_exact:
        difference = find_difference(rounding)
    counts = len(one.windows), len(one.classifications)
    return ReplayComparison(difference, *counts, is_exact=is_exact)


def _first_difference(
    what: str, one: Sequence[Any], other: Sequence[Any], names: tuple[str, str], rounding: float
) -> str | None:
    for left, right in zip(one, other, strict=False):
        for item in fields(left):
            a, b = getattr(left, item.name), getattr(right, item.name)
            if not _same(a, b, rounding):
                return (
                    f'{what} of trial {left.trial_id or "(none)"}: {item.name} is '
                    f'{_short(a)} in {names[0]} and {_short(b)} in {names[1]}'
                )
    if len(one) != len(other):
        return f'{len(one)} {what} in {names[0]}, {len(other)} in {names[1]}'
    return None


def _same(a: Any, b: Any, rounding: float) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
        if a.shape != b.shape:
            return False
        if not rounding:
            return bool(a.tobytes() == b.tobytes())
        largest = float(np.max(np.abs(a), initial=0.0, where=np.isfinite(a)))
        return bool(np.allclose(a, b, rtol=0.0, atol=rounding * largest, equal_nan=True))
    if rounding and is_dataclass(a) and type(a) is type(b):
        pairs = [(getattr(a, item.name), getattr(b, item.name)) for item in fields(a)]
        return all(_same(x, y, rounding) for x, y in pairs)
    if rounding and isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        return all(_same(x, y, rounding) for x, y in zip(a, b, strict=True))
    if rounding and isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=rounding) or (math.isnan(a) and math.isnan(b))
    # The text distinguishes -0.0 from 0.0, which are equal as numbers.
    return bool(a == b) and repr(a) == repr(b)


def _short(value: Any) -> str:
    text = repr(value.tolist() if isinstance(value, np.ndarray) else value)
    return text if len(text) <= 60 else text[:57] + '...'
