# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Any recording that is not a bag of ours, as one set of labelled trials."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tactile_bags.recording import RecordedBag, Recording
from tactile_bags.sources.files import find_leaves, Kind, Leaf, Notes, SourceError, SourceOptions
from tactile_classifier.datasets.archive import LabelledTrials


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
    own = [leaf for leaf in leaves if leaf.kind is Kind.BAG and _is_own(leaf.path)]
    others = [leaf for leaf in leaves if leaf not in own]
    if own and others:
        raise SourceError(
            f'take bags with trial events or other recordings, not both: {own[0].path} is the '
            f'one, {others[0].path} the other'
        )
    return [leaf.path for leaf in own], others


def _is_own(path: Path) -> bool:
    with RecordedBag(path, needs_strain=False) as bag:
        return isinstance(bag, RecordedBag) and bag.is_own


def load_trials(
    leaves: Sequence[Leaf],
    options: SourceOptions,
    _notes: Notes,
    *,
    folds: int,
    skip_bad: bool,
) -> LabelledTrials:
    """Return the trials of files and bags; see `Recording.to_arrays`."""
    roots = list(dict.fromkeys(leaf.root for leaf in leaves))
    with Recording.load(roots, options) as recording:
        return recording.to_arrays(folds=folds, skip_bad=skip_bad)
