# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One set of labelled trials as the report needs it: features, and some of the signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_bags.bag_reader import TactileBag
from tactile_classifier.datasets.archive import Skipped
from tactile_classifier.datasets.dataset import FeatureTable, plain_name
from tactile_classifier.datasets.splits import grouped_split, Split
from tactile_classifier.errors import EvaluationError
from tactile_classifier.training.feature_choice import Candidate, FeatureChoice
from tactile_features.records import PROTOCOL_STIFFNESS
from tactile_lab.datasets.bag_tables import Key, name_table
from tactile_lab.datasets.traces import read_spans, read_trace, TrialTrace


@dataclass(frozen=True)
class Example:
    """The window of one trial.

    Attributes
    ----------
    row : int
        Its row in the table of features.
    time_s, signal : ndarray of shape (samples,)
        Time since the window's first sample [s], and the samples.
    """

    row: int
    time_s: NDArray[np.float64]
    signal: NDArray[np.float64]


@dataclass(frozen=True)
class TrialExample:
    """A whole trial with its phases, and the window that its features come from [s]."""

    row: int
    trace: TrialTrace
    window_s: tuple[float, float]


@dataclass(frozen=True)
class RecordingSet:
    """Trials of one task and contact.

    Attributes
    ----------
    title : str
        Task, contact or source, and whether it is simulated.
    contact : str
        Empty where there is none, as in an archive.
    hold_out : tuple of tuple of str
        The columns of each grouped split that stands beside plain folds.
    unit : str
        Of the signal: ``N``, or ``raw`` for an archive, which does not say.
    examples : tuple of Example
        One a label.
    trial : TrialExample or None
        A trial with its phases, where recordings have them.
    published : FeatureTable or None
        The features of the same trials as the paper computes them, where ``table`` has others.
    splits : tuple of Split
        Stated trials to train on and to test on, beside plain folds and grouped splits.
    skipped : tuple of Skipped
        Trials that could not be used.
    steps : tuple of str
        What was done to the signals first, in words.
    choice : (Candidate, FeatureChoice) or None
        Set of features and classifier that folds chose, and from what; None where they did not.
    not_done : tuple of str
        One sentence for each usual split that the trials do not allow.
    """

    title: str
    contact: str
    simulated: bool
    table: FeatureTable
    hold_out: tuple[tuple[str, ...], ...]
    unit: str
    examples: tuple[Example, ...] = ()
    trial: TrialExample | None = None
    published: FeatureTable | None = None
    splits: tuple[Split, ...] = ()
    skipped: tuple[Skipped, ...] = ()
    steps: tuple[str, ...] = ()
    choice: tuple[Candidate, FeatureChoice] | None = None
    not_done: tuple[str, ...] = ()

    def tell_preparation(self, most: int | None = None) -> list[str]:
        """Return what was done to the signals and which trials were skipped, ``most`` of them."""
        lines = list(self.steps)
        if self.skipped:
            lines.append(f'skipped {len(self.skipped)} trials; rows count from 0:')
            lines += [f'row {each.row}: {each.reason}' for each in self.skipped[:most]]
        if most is not None and len(self.skipped) > most:
            lines.append(f'and {len(self.skipped) - most} more: see the report, or --json')
        return lines


def _first_rows(table: FeatureTable) -> list[int]:
    """Return the row of the first trial of each label."""
    return [int(np.argmax(table.labels == label)) for label in np.unique(table.labels)]


def array_examples(
    table: FeatureTable, signals: NDArray[np.float64], rate_hz: float
) -> tuple[Example, ...]:
    """Return one example a label from ready-cut windows, shape (trials, samples)."""
    time_s = np.asarray(np.arange(signals.shape[1]) / rate_hz, dtype=np.float64)
    return tuple(Example(row, time_s, signals[row]) for row in _first_rows(table))


def bag_sets(
    tables: Mapping[Key, FeatureTable],
    hold_out: Sequence[Sequence[str]] | None = None,
    also: Sequence[str] = (),
) -> list[RecordingSet]:
    """Return the sets of some bags, with signals read from them.

    Parameters
    ----------
    tables : mapping of tuple to FeatureTable
        As `read_tables` returns them.
    hold_out : sequence of sequence of str, optional
        Columns of the grouped splits. When left out, one session is held out where there are
        several that have all labels, and one block of trials where not.
    also : sequence of str
        Columns that are held out then, too, one by one, where that can be done.

    Raises
    ------
    BagError
        When a bag has gone.
    """
    sets = []
    for key, table in tables.items():
        task, contact = key[:2]
        simulated = bool(table.column('simulated').any())
        chosen, not_done = _usual_splits(table, also) if hold_out is None else (hold_out, [])
        sets.append(
            RecordingSet(
                title=name_table(key, table) + (', simulated' if simulated else ''),
                contact=contact,
                simulated=simulated,
                table=table,
                hold_out=tuple(tuple(columns) for columns in chosen),
                not_done=tuple(not_done),
                unit='N',
                examples=_bag_examples(table),
                trial=_bag_trial(table) if task == PROTOCOL_STIFFNESS else None,
            )
        )
    return sets


def _usual_splits(
    table: FeatureTable, also: Sequence[str]
) -> tuple[list[tuple[str, ...]], list[str]]:
    """Return the columns of each split, and a sentence for each that cannot be done."""
    not_done: list[str] = []

    def can_hold_out(column: str) -> bool:
        try:
            grouped_split(table, [column])
        except EvaluationError as error:
            not_done.append(f'one {plain_name(column)} held out: {error}')
            return False
        return True

    first = next(filter(can_hold_out, ('session_id', 'trial_block')), None)
    return [(column,) for column in (first, *filter(can_hold_out, also)) if column], not_done


def _bag_examples(table: FeatureTable) -> tuple[Example, ...]:
    """Read one example a label from the bags that the table was made of."""
    rows = _first_rows(table)
    names = ('bag', 'namespace', 'window_start_ns', 'window_end_ns')
    columns = [table.column(name)[rows].tolist() for name in names]
    examples = {}
    sources = list(zip(*columns[:2], strict=True))
    spans_ns = list(zip(*columns[2:], strict=True))
    for source in sorted(set(sources)):
        here = [i for i, each in enumerate(sources) if each == source]
        with TactileBag(Path(source[0])) as bag:
            found = read_spans(bag, source[1], [spans_ns[i] for i in here])
        examples.update({i: Example(rows[i], *each) for i, each in zip(here, found, strict=True)})
    return tuple(examples[i] for i in range(len(rows)))


def _bag_trial(table: FeatureTable) -> TrialExample | None:
    """Read the whole of one stiffness trial: that with the steepest relaxation of its kind.

    None when its name came more than once, so that its phases cannot be told apart.
    """
    rows = _first_rows(table)
    row = rows[int(np.argmin(table.values[rows, 0]))]
    trial_id = str(table.column('trial_id')[row])
    if np.sum(table.column('trial_id') == trial_id) > 1:
        return None
    with TactileBag(Path(str(table.column('bag')[row]))) as bag:
        trace = read_trace(bag, trial_id, str(table.column('namespace')[row]))
    start_s, end_s = (
        (int(table.column(name)[row]) - trace.begin_ns) * 1e-9
        for name in ('window_start_ns', 'window_end_ns')
    )
    return TrialExample(row, trace, (start_s, end_s))
