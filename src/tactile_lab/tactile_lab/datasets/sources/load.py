# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Any recording that is not a bag of ours, as one set of labelled trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tactile_classifier.datasets.archive import LabelledTrials, load_archive, trials_from_arrays
from tactile_lab.datasets.sources.array_files import read_array_trials, read_labelled_array
from tactile_lab.datasets.sources.bag_trials import is_own, read_bag_trials
from tactile_lab.datasets.sources.leaves import find_leaves, Kind, Leaf
from tactile_lab.datasets.sources.options import SourceOptions
from tactile_lab.datasets.sources.questions import Questions, SourceError
from tactile_lab.datasets.sources.raw_trials import arrays_from_trials
from tactile_lab.datasets.sources.table_trials import read_table_trials

_READERS = {
    Kind.TABLE: read_table_trials,
    Kind.ARRAY: read_array_trials,
    Kind.BAG: read_bag_trials,
}


def split_sources(paths: Sequence[Path], options: SourceOptions) -> tuple[list[Path], list[Leaf]]:
    """Return the bags of ours, with trial events, or all other files and bags.

    With a topic stated, no bag is taken as ours.

    Raises
    ------
    SourceError
        When a path holds no recording, or both kinds are there.
    BagError
        When a bag cannot be read.
    """
    leaves = find_leaves(paths)
    if options.topic:
        return [], leaves
    own = [leaf for leaf in leaves if leaf.kind is Kind.BAG and is_own(leaf.path)]
    others = [leaf for leaf in leaves if leaf not in own]
    if own and others:
        raise SourceError(
            f'take bags with trial events or other recordings, not both: {own[0].path} is the '
            f'one, {others[0].path} the other'
        )
    return [leaf.path for leaf in own], others


def load_trials(
    leaves: Sequence[Leaf],
    options: SourceOptions,
    questions: Questions,
    *,
    folds: int,
    skip_bad: bool,
) -> LabelledTrials:
    """Return the trials of files and bags; what was taken for what stands in ``steps``.

    Parameters
    ----------
    leaves : sequence of Leaf
        All of one kind.
    folds : int
        Fewer trials than this are refused; 0: any number.
    skip_bad : bool
        Leave out trials that cannot be used; otherwise the first one is an error.

    Raises
    ------
    SourceError
        When they are of several kinds, or something is not known of them.
    DatasetError
        When the trials cannot be used.
    """
    kinds = {leaf.kind for leaf in leaves}
    if len(kinds) > 1:
        raise SourceError(
            f'these are recordings of several kinds: {_examples(leaves)}; import each kind apart'
        )
    (kind,) = kinds
    if kind is Kind.ARCHIVE:
        if len(leaves) > 1:
            raise SourceError(f'take one archive at a time, not {_examples(leaves)}')
        path = leaves[0].path
        trials = load_archive(path, folds, skip_bad=skip_bad, rate_hz=options.rate_hz)
        return replace(trials, steps=(*questions.notes, *trials.steps))
    if kind is Kind.ARRAY and len(leaves) == 1:
        arrays = read_labelled_array(leaves[0], options)
        if arrays is not None:
            return trials_from_arrays(
                leaves[0].path, arrays, folds, skip_bad=skip_bad, rate_hz=options.rate_hz
            )
    found = _READERS[kind](leaves, options, questions)
    arrays = arrays_from_trials(found, options.rate_hz, questions, skip_bad=skip_bad)
    trials = trials_from_arrays(leaves[0].root, arrays, folds, skip_bad=skip_bad)
    return replace(trials, steps=(*questions.notes, *trials.steps))


def _examples(leaves: Sequence[Leaf]) -> str:
    return ', '.join({leaf.kind: leaf.name for leaf in leaves}.values())
