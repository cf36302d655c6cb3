# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings of any kind, as trials with signals.

```python
trials = TrialSet.load('bags')
for trial in trials:
    trial.label, trial.session_id, trial.why_not, trial.signal, trial.events, trial.answers
trials.to_frame()  # one row per trial
trials = trials.select('session_id=a,b').exclude('label=cork', 'the plate was loose')
```

A recording may consist of bags of this package, the folder of an experiment, an archive
(``.npz``), files or folders of CSV, Parquet and ``.npy``, bags of other software, or a list file
of these.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from copy import copy
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_analysis.options import SourceError, SourceOptions
from tactile_analysis.sources.files import find_leaves, ImportNotes, SourceFile, SourceKind
from tactile_analysis.sources.raw_trials import (
    arrays_from_trials,
    find_fault,
    RawTrial,
)
from tactile_bags.experiment_journal import experiment_of
from tactile_bags.trial import Signal, Trial
from tactile_classifier.datasets.archive import (
    LabelledTrials,
    read_arrays,
    trials_from_arrays,
)
from tactile_classifier.datasets.dataset import find_column
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    import pyarrow

    from tactile_bags.recorded_bag import RecordedBag

OWN = 'bags with trial events'
"""Kind of a recording of bags of this package; other kinds are `SourceKind` values."""

Columns = Mapping[str, NDArray[Any]]
"""Properties of trials by name, each of shape (trials,)."""

Where = str | ArrayLike
"""Selection of trials; see `TrialSet.select`."""


class TrialSet:
    """Trials of one or several recordings. A context manager; after closing, nothing can be read.

    Make one by `load`.

    Attributes
    ----------
    kind : str
        `OWN`, or a `SourceKind` value: ``archive``, ``array``, ``table``, ``bag`` (of other
        software).
    name : str
        Name of the first path.
    paths : tuple of Path
        Bags and files that were read.
    bags : tuple of RecordedBag
        Open bags of this package; they can be used as `TactileBag`.
    notes : list of str
        Unknown facts, then assumptions that were made.
    """

    def __init__(
        self,
        kind: str,
        name: str,
        paths: Sequence[Path],
        *,
        bags: Sequence[RecordedBag] = (),
        arrays: Mapping[str, NDArray[Any]] | None = None,
        raw: Sequence[RawTrial] = (),
        options: SourceOptions | None = None,
        notes: ImportNotes | None = None,
    ) -> None:
        self.kind = kind
        self.name = name
        self.paths = tuple(paths)
        self.bags = tuple(bags)
        self._arrays = arrays
        self._raw = tuple(raw)
        self._options = options or SourceOptions()
        self._found = notes or ImportNotes()
        self._numbers: tuple[int, ...] | None = None
        self._excluded: dict[int, str] = {}

    @classmethod
    def load(
        cls, paths: str | Path | Sequence[str | Path], options: SourceOptions | None = None
    ) -> TrialSet:
        """Read a recording.

        Parameters
        ----------
        paths : path or sequence of paths
            Paths of recordings, all of the same kind.
        options : SourceOptions, optional
            Statements that complete the recording; bags of this package need none. Labels that
            are unknown are empty, and `to_arrays` raises an error that says how to state them.

        Raises
        ------
        SourceError
            When there is no recording, or a required fact is unknown.
        BagError, DatasetError
            When a bag or an archive cannot be read.
        """
        options = options or SourceOptions()
        named = [paths] if isinstance(paths, (str, Path)) else paths
        leaves = find_leaves([Path(path) for path in named])
        own = _open_own(leaves, options)
        if own:
            files = [bag.path for bag in own]
            return cls(OWN, leaves[0].root.name, files, bags=own, options=options)
        kinds = {leaf.kind for leaf in leaves}
        if len(kinds) > 1:
            raise SourceError(
                f'these are recordings of several kinds: {_examples(leaves)}; import each kind '
                'apart'
            )
        (kind,) = kinds
        notes = ImportNotes()
        arrays, found = _read_others(kind, leaves, options, notes)
        raw = [trial.in_newtons(options.unit) for trial in found]
        for before, after in zip(found, raw, strict=True):
            if (unit := options.unit or before.unit) != after.unit:
                notes.add(f'force: converted from {unit} to N')
        files = [leaf.path for leaf in leaves]
        root = leaves[0].root if raw else leaves[0].path
        return cls(
            kind.value, root.name or str(root), files, arrays=arrays, raw=raw, options=options,
            notes=notes,
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.trials)

    def __iter__(self) -> Iterator[Trial]:
        return iter(self.trials)

    def __enter__(self) -> TrialSet:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the bags. May be called repeatedly."""
        for bag in self.bags:
            bag.close()

    @property
    def is_own(self) -> bool:
        """True for bags of this package, which state phases and features."""
        return self.kind == OWN

    @cached_property
    def trials(self) -> tuple[Trial, ...]:
        """All trials; those with a non-empty ``why_not`` are excluded from evaluation."""
        if self.is_own:
            fingers = ((bag, namespace) for bag in self.bags for namespace in bag.namespaces)
            return tuple(t for bag, namespace in fingers for t in bag.trials(namespace))
        if self._raw:
            return tuple(self._raw_trial(raw) for raw in self._raw)
        return self._archive_trials()

    @property
    def unit(self) -> str:
        """Unit of all signals; empty if unknown or not the same for all."""
        if self.is_own:
            return 'N'
        if self._raw:
            units = {raw.unit for raw in self._raw}
            return units.pop() if len(units) == 1 else ''
        return self._whole.unit

    @property
    def notes(self) -> list[str]:
        """Unknown facts as the first line, then assumptions, then the excluded trials."""
        unknown = [] if self.unit else ['unit of the signal (--unit N)']
        if self._raw and self._options.rate_hz is None and not any(r.rate_hz for r in self._raw):
            unknown.append('sample rate (--rate-hz)')
        first = [f'unknown: {", ".join(unknown)}'] if unknown else []
        excluded = [
            f'excluded: trial {trial.name}: {self._excluded[number]}'
            for number, trial in zip(self._numbers or (), self.trials, strict=False)
            if number in self._excluded
        ]
        return [*first, *self._found.lines, *excluded]

    # -- selection ---------------------------------------------------------------------------

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """Properties of the trials by name, each of shape (trials,).

        ``trial``, ``label``, ``session``, ``mounting``, ``contact``, ``task``, ``simulated``,
        ``source`` and ``why_not`` always exist. Other properties follow, such as
        ``glide_speed_m_s``. Where only some trials have a property, the others have None.
        """
        trials = self.trials
        found: dict[str, list[Any]] = {
            'trial': [trial.name for trial in trials],
            'label': [trial.label for trial in trials],
            'session': [trial.session_id for trial in trials],
            'mounting': [trial.mounting_id for trial in trials],
            'contact': [trial.contact for trial in trials],
            'task': [trial.task for trial in trials],
            'simulated': [trial.simulated for trial in trials],
            'source': [trial.source for trial in trials],
            'why_not': [trial.why_not for trial in trials],
        }
        for name in dict.fromkeys(name for trial in trials for name in trial.columns):
            found.setdefault(name, [trial.columns.get(name) for trial in trials])
        return {name: _to_column(values) for name, values in found.items()}

    def to_frame(self) -> Any:
        """Return `columns` as a pandas.DataFrame with one row per trial."""
        import pandas  # slow to import

        return pandas.DataFrame(self.columns)

    def select(self, where: Where) -> TrialSet:
        """Return a set with some of the trials; both sets read from the same open bags.

        Parameters
        ----------
        where : str, or array_like of bool of shape (trials,)
            ``COLUMN=VALUE[,VALUE...]`` with a name of `columns`, ``COLUMN`` for a boolean column,
            or a mask.

        Raises
        ------
        TactileError
            When there is no such column, no trial is selected, or the mask has another shape.
        """
        chosen = np.flatnonzero(self._find_mask(where)).tolist()
        return self._change([(i, self.trials[i]) for i in chosen])

    def exclude(self, where: Where, why: str) -> TrialSet:
        """Return a set in which some trials are excluded from training and evaluation.

        Parameters
        ----------
        where : str, or array_like of bool of shape (trials,)
            As in `select`.
        why : str
            The reason, for ``why_not``. Files are not changed.
        """
        if not why:
            raise SourceError('exclude: state why the trials are excluded')
        mask = self._find_mask(where)
        return self._change(
            [(i, replace(t, why_not=why) if mask[i] else t) for i, t in enumerate(self.trials)],
            dict.fromkeys(np.flatnonzero(mask).tolist(), why),
        )

    def relabel(self, where: Where, label: str) -> TrialSet:
        """Return a set in which some trials have another label; files are not changed.

        ``where`` is as in `select`.
        """
        mask = self._find_mask(where)
        return self._change(
            [(i, replace(t, label=label) if mask[i] else t) for i, t in enumerate(self.trials)]
        )

    def find_window(
        self, source: str, namespace: str, name: str, start_ns: int
    ) -> tuple[Trial, str] | None:
        """Return the trial of a window in a bag, and the reason that was given to `exclude`.

        Only for sets with `is_changed`. The reason is empty if the trial is not excluded. Returns
        None if the trial is not in this set. ``start_ns`` is the start of the window (ROS time)
        [ns].
        """
        assert self._numbers is not None, 'only for sets that were changed'
        found = [
            (trial.begin_ns, number, trial)
            for number, trial in zip(self._numbers, self.trials, strict=True)
            if (trial.source, trial.namespace, trial.name) == (source, namespace, name)
            and trial.events
            and trial.begin_ns is not None
            and trial.begin_ns <= start_ns <= trial.events[-1].stamp_ns
        ]
        if not found:
            return None
        _, number, trial = max(found, key=lambda each: each[0])
        return trial, self._excluded.get(number, '')

    @property
    def is_changed(self) -> bool:
        """True for sets that `select`, `exclude` or `relabel` returned."""
        return self._numbers is not None

    def _find_mask(self, where: Where) -> NDArray[np.bool_]:
        if isinstance(where, str):
            return select_trials(self.columns, where, 'select')
        mask = np.asarray(where)
        if mask.shape != (len(self),) or mask.dtype.kind != 'b':
            raise SourceError(
                f'the mask is {mask.dtype} of shape {mask.shape}; it must be bool of shape '
                f'({len(self)},), one per trial'
            )
        if not mask.any():
            raise SourceError('the mask selects no trial')
        return mask

    def _change(
        self,
        trials: Sequence[tuple[int, Trial]],
        excluded: Mapping[int, str] = MappingProxyType({}),
    ) -> TrialSet:
        """Return a set with these trials, each with its index in this set.

        ``excluded`` has the reasons of newly excluded trials, by index.
        """
        numbers = self._numbers or tuple(range(len(self)))
        found = copy(self)
        found.trials = tuple(trial for _, trial in trials)
        found._numbers = tuple(numbers[i] for i, _ in trials)  # noqa: SLF001 (of this class)
        newly = {numbers[i]: why for i, why in excluded.items()}
        found._excluded = self._excluded | newly  # noqa: SLF001
        return found

    def _keep(self, loaded: LabelledTrials) -> LabelledTrials:
        """Return the included trials of an archive with their present labels."""
        if self._numbers is None:
            return loaded
        rows = [*self._whole.rows.tolist(), *(each.row for each in self._whole.skipped)]
        kept = {
            rows[number]: trial.label
            for number, trial in zip(self._numbers, self.trials, strict=True)
            if not trial.why_not
        }
        mask = np.isin(loaded.rows, list(kept))
        if not mask.any():
            raise SourceError(f'{self.paths[0]}: no trial is included')
        labels = np.array([kept[row] for row in loaded.rows[mask].tolist()])
        return replace(loaded.take(mask), label=labels)

    def _kept_raw(self) -> tuple[RawTrial, ...]:
        """Return the trials of files that are not excluded, with their present labels."""
        if self._numbers is None:
            return self._raw
        return tuple(
            replace(self._raw[n], columns={**self._raw[n].columns, 'label': trial.label})
            for n, trial in zip(self._numbers, self.trials, strict=True)
            if n not in self._excluded
        )

    # -- trials of other software ------------------------------------------------------------

    @cached_property
    def _whole(self) -> LabelledTrials:
        """All usable trials of an archive."""
        assert self._arrays is not None
        return self._from_arrays(folds=0, skip_bad=True, needs_label=False)

    def _from_arrays(self, *, folds: int, skip_bad: bool, needs_label: bool) -> LabelledTrials:
        return trials_from_arrays(
            self.paths[0],
            dict(self._arrays or {}),
            folds,
            skip_bad=skip_bad,
            rate_hz=self._options.rate_hz,
            unit=self._options.unit,
            needs_label=needs_label,
        )

    def _raw_trial(self, raw: RawTrial) -> Trial:
        def load() -> Signal:
            rate_hz = self._options.rate_hz or raw.rate_hz
            time_s = raw.time_s
            if time_s is None and rate_hz is not None:
                time_s = np.arange(raw.values.shape[1]) / rate_hz
            names = raw.channels or tuple(f'channel_{i}' for i in range(len(raw.values)))
            return Signal(time_s, raw.values, names, raw.unit, rate_hz)

        why_not = find_fault(raw, self._options.rate_hz or raw.rate_hz)
        source = str(raw.columns.get('source', ''))
        return _other_trial(raw.name, source, raw.columns, load, why_not)

    def _archive_trials(self) -> tuple[Trial, ...]:
        whole = self._whole
        trials = []
        for i in range(len(whole)):
            columns = {name: column[i].item() for name, column in whole.columns.items()}
            known = {**columns, 'label': str(whole.label[i])}
            name = str(columns.get('trial', whole.rows[i]))

            def load(i: int = i) -> Signal:
                values = whole.x[i, :, : whole.lengths[i]].astype(np.float64)
                times_s = np.arange(values.shape[1]) / whole.rate_hz
                return Signal(times_s, values, whole.channels, whole.unit, whole.rate_hz)

            trials.append(_other_trial(name, str(self.paths[0]), known, load))
        for each in whole.skipped:
            why_not = f'row {each.row}: {each.reason}'
            trials.append(Trial(str(each.row), str(self.paths[0]), '', why_not=why_not))
        return tuple(trials)

    # -- conversions -------------------------------------------------------------------------

    def to_arrays(
        self, *, folds: int = 0, skip_bad: bool = False, needs_label: bool = True
    ) -> LabelledTrials:
        """Return the included trials at one constant rate, in the form of an archive.

        Parameters
        ----------
        folds : int
            Refuse fewer trials than this; 0 accepts any number.
        skip_bad : bool
            Skip unusable trials; otherwise the first of them raises an error.
        needs_label : bool
            If False, trials without a label have an empty one.

        Raises
        ------
        SourceError
            When rates or channels of the trials differ, a trial is unusable, or labels are
            missing.
        DatasetError
            When the trials are unusable as a data set.
        """
        if self._arrays is not None:
            trials = self._from_arrays(
                folds=folds, skip_bad=skip_bad or self.is_changed, needs_label=needs_label
            )
            trials = self._keep(trials)
            return replace(trials, steps=(*self.notes, *trials.steps))
        if needs_label and self._found.no_label is not None and not all(t.label for t in self):
            raise self._found.no_label
        raw, notes = self._kept_raw(), ImportNotes(self.notes)
        if self.is_own:
            raw = tuple(_raw_of(trial, name) for trial, name in self._named_trials())
        arrays = arrays_from_trials(raw, self._options.rate_hz, notes, skip_bad=skip_bad)
        trials = trials_from_arrays(
            Path(self.name), arrays, folds, skip_bad=skip_bad, needs_label=needs_label
        )
        return replace(trials, unit=self.unit, steps=(*notes.lines, *trials.steps))

    def _named_trials(self) -> list[tuple[Trial, str]]:
        """Return the included trials, each with a unique name."""
        counting = [trial for trial in self.trials if not trial.why_not]
        names = [trial.name for trial in counting]
        if len(set(names)) < len(names):
            names = [f'{Path(t.source).name}/{t.namespace}/{t.name}' for t in counting]
        turns: Counter[str] = Counter()
        for i, name in enumerate(names):
            turns[name] += 1
            names[i] = f'{name}#{turns[name]}' if turns[name] > 1 else name
        return list(zip(counting, names, strict=True))

    def to_table(self) -> pyarrow.Table:
        """Return the samples of the included trials as one long table with one row per sample.

        The columns are ``trial``, ``label``, ``time_s``, one per channel, and one per known
        property of the trials. The metadata of a channel contain its ``unit``; the metadata entry
        ``tactile`` of the table contains the rate as JSON.

        Raises
        ------
        SourceError
            When no trial is included, channels differ, or times are unknown.
        """
        from tactile_analysis.sources.table_files import (
            build_long_table,  # pyarrow is slow to import
        )

        # Only archives state a rate; otherwise the times show it.
        stated_hz = None if self._arrays is None else self.rate_hz
        return build_long_table(self._named_trials(), stated_hz)

    @property
    def rate_hz(self) -> float | None:
        """Sample rate of all trials [Hz]; None if unknown or not the same for all."""
        if self._options.rate_hz is not None:
            return self._options.rate_hz
        if self._arrays is not None:
            return self._whole.rate_hz
        if self.is_own:
            rates = {bag.rate_hz(namespace) for bag in self.bags for namespace in bag.namespaces}
        else:
            rates = {raw.rate_hz for raw in self._raw}
        return rates.pop() if len(rates) == 1 else None


def _to_column(values: Sequence[Any]) -> NDArray[Any]:
    return np.array(values, dtype=object if any(value is None for value in values) else None)


def _other_trial(
    name: str,
    source: str,
    columns: Mapping[str, Any],
    load: Callable[[], Signal],
    why_not: str = '',
) -> Trial:
    def known(*names: str) -> str:
        return str(next((columns[n] for n in names if n in columns), ''))

    return Trial(
        name=name,
        source=source,
        label=known('label'),
        session_id=known('session_id', 'session'),
        mounting_id=known('mounting_id', 'mounting'),
        contact=known('contact'),
        task=known('task'),
        why_not=why_not,
        columns=columns,
        load_signal=load,
    )


def _raw_of(trial: Trial, name: str) -> RawTrial:
    signal = trial.signal
    time_s = signal.time_s
    assert time_s is not None
    columns = {**trial.columns, 'label': trial.label}
    units = (signal.unit,) * len(signal.channels)
    return RawTrial(name, signal.values, time_s, columns, signal.channels, units)


def _open_own(leaves: Sequence[SourceFile], options: SourceOptions) -> list[RecordedBag]:
    """Open and return the bags that have trial events.

    If ``options.topic`` is set, there are none: bags are then read like other recordings.
    """
    if options.topic or not any(leaf.kind is SourceKind.BAG for leaf in leaves):
        return []
    from tactile_bags.recorded_bag import correct_bags, RecordedBag  # they import rosbags

    with ExitStack() as stack:
        own: list[RecordedBag] = []
        others: list[SourceFile] = []
        empty: list[SourceFile] = []
        for leaf in leaves:
            if leaf.kind is SourceKind.BAG:
                bag = RecordedBag(leaf.path, needs_strain=False)
                if bag.is_own:
                    stack.callback(bag.close)
                    own.append(bag)
                    continue
                bag.close()
                if experiment_of(leaf.path):  # the run ended before its first trial
                    empty.append(leaf)
                    continue
            others.append(leaf)
        if empty and not own and not others:
            raise SourceError(f'{empty[0].path}: no trial was recorded')
        if own and others:
            raise SourceError(
                f'combine no bags with trial events and other recordings: {own[0].path} has '
                f'trial events, {others[0].path} has none'
            )
        correct_bags(own)
        stack.pop_all()
    return own


def _read_others(
    kind: SourceKind, leaves: Sequence[SourceFile], options: SourceOptions, notes: ImportNotes
) -> tuple[Mapping[str, NDArray[Any]] | None, list[RawTrial]]:
    """Return the arrays of an archive, or the trials of other files."""
    if kind is SourceKind.ARCHIVE:
        if len(leaves) > 1:
            raise SourceError(f'take one archive at a time, not {_examples(leaves)}')
        return read_arrays(leaves[0].path), []
    if kind is SourceKind.TABLE:
        from tactile_analysis.sources.table_trials import read_table_trials  # pyarrow is slow

        return None, read_table_trials(leaves, options, notes)
    if kind is SourceKind.BAG:
        from tactile_analysis.sources.other_bags import read_bag_trials

        return None, read_bag_trials(leaves, options, notes)
    from tactile_analysis.sources.arrays import read_array_trials, read_labelled_array

    if len(leaves) == 1:
        arrays = read_labelled_array(leaves[0], options)
        if arrays is not None:
            return arrays, []
    return None, read_array_trials(leaves, options, notes)


def _examples(leaves: Sequence[SourceFile]) -> str:
    return ', '.join({leaf.kind: leaf.name for leaf in leaves}.values())


def select_trials(columns: Columns, text: str, option: str) -> NDArray[np.bool_]:
    """Return a mask of the trials with ``COLUMN=VALUE[,VALUE...]``, or with a true ``COLUMN``.

    Raises `TactileError` if the column does not exist, the value is invalid for the column, or no
    trial is selected.
    """
    asked, equals, values = text.partition('=')
    name = find_column(columns, asked)
    if name not in columns:
        raise TactileError(
            f'--{option}: there is no column "{asked}"; there are: {", ".join(columns) or "none"}'
        )
    column = np.asarray(columns[name])
    if not equals:
        if column.dtype.kind not in 'biu':
            raise TactileError(f'--{option}: column {name} is not boolean; write {name}=VALUE')
        chosen = column.astype(bool)
    else:
        chosen = np.isin(column, [_value(v, column, name, option) for v in values.split(',')])
    if not chosen.any():
        raise TactileError(f'--{option}: no trial has {text if equals else f"{name} = True"}')
    return chosen


def _value(text: str, column: NDArray[Any], name: str, option: str) -> Any:
    """Convert ``text`` to the type of the column."""
    if column.dtype.kind == 'U':
        return text
    if column.dtype.kind == 'b' and text.lower() in ('true', 'false'):
        return text.lower() == 'true'
    try:
        return column.dtype.type(float(text) if column.dtype.kind == 'b' else text)
    except (ValueError, OverflowError) as error:
        raise TactileError(
            f'--{option}: "{text}" is not a valid value of column {name} ({column.dtype})'
        ) from error
