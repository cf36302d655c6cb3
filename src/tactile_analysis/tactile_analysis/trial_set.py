# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings of any kind, as trials with signals.

```python
trials = TrialSet.load('bags')
for trial in trials:
    trial.label, trial.session_id, trial.why_not, trial.signal, trial.events, trial.answers
trials.to_frame()  # one row per trial
trials = trials.select('session_id=a,b').exclude('label=cork', 'the plate was loose')
x, y, groups = trials.crop(1.0, 4.0).windows('session_id')  # arrays for scikit-learn
trials.save('trials.npz')
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
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_analysis.options import SourceError, SourceOptions
from tactile_analysis.sources.files import (
    find_leaves,
    ImportNotes,
    SourceFile,
    SourceKind,
)
from tactile_analysis.sources.signals import (
    choose_rate,
    find_ratio,
    find_time_fault,
    join_columns,
    make_even,
    resample,
)
from tactile_bags.experiment_journal import experiment_of
from tactile_bags.trial import NO_LABEL, Signal, Trial
from tactile_classifier.datasets.dataset import find_column
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    import pyarrow

    from tactile_bags.recorded_bag import RecordedBag

OWN = 'bags with trial events'
"""Kind of a recording of bags of this package; other kinds are `SourceKind` values."""

MAX_BYTES = 2**30
"""Largest size of all signals after `TrialSet.resample` [byte]."""

FEW_SAMPLES = 16
"""Trials with fewer samples cause a warning: their spectrum has at most eight components."""

RESERVED = ('x', 'rate_hz', 'length', 'offsets', 'unit', 'channel_names')
"""Names of arrays in an archive that are not columns."""

Columns = Mapping[str, NDArray[Any]]
"""Properties of trials by name, each of shape (trials,)."""

Value = TypeVar('Value')

Where = str | ArrayLike
"""Selection of trials; see `TrialSet.select`."""


class TrialSet:
    """Trials of one or several recordings. A context manager; after closing, nothing can be read.

    `load` creates a set. Methods that change trials return another set.

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
    is_changed : bool
        True if `select`, `exclude` or `relabel` returned this set.
    has_new_signals : bool
        True if the signals were cropped or resampled.
    """

    def __init__(
        self,
        kind: str,
        name: str,
        paths: Sequence[Path],
        *,
        bags: Sequence[RecordedBag] = (),
        trials: Sequence[Trial] | None = None,
        notes: ImportNotes | None = None,
    ) -> None:
        self.kind = kind
        self.name = name
        self.paths = tuple(paths)
        self.bags = tuple(bags)
        self.is_changed = False
        self._steps: tuple[str, ...] = ()
        self.has_new_signals = False
        self._is_even = False
        self._found = notes or ImportNotes()
        if trials is not None:
            self.trials = tuple(trials)

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
            Facts that the recording does not contain, such as its rate; bags of this package
            need none. Unknown labels are empty, and `windows` raises an error that says how to
            state them.

        Raises
        ------
        SourceError
            When there is no recording, it cannot be read, or a required fact is unknown.
        BagError
            When a bag cannot be read.
        """
        options = options or SourceOptions()
        named = [paths] if isinstance(paths, (str, Path)) else paths
        leaves = find_leaves([Path(path) for path in named])
        own = _open_own(leaves, options)
        if own:
            files = [bag.path for bag in own]
            return cls(OWN, leaves[0].root.name, files, bags=own)
        kinds = {leaf.kind for leaf in leaves}
        if len(kinds) > 1:
            raise SourceError(
                f'these are recordings of several kinds: {_examples(leaves)}; import each kind '
                'apart'
            )
        (kind,) = kinds
        notes = ImportNotes()
        trials = _read_others(kind, leaves, options, notes)
        files = [leaf.path for leaf in leaves]
        name = leaves[0].root.name or str(leaves[0].root)
        if kind is SourceKind.ARCHIVE:
            name = leaves[0].path.name
        return cls(kind.value, name, files, trials=trials, notes=notes)

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
        """All trials; those with a ``why_not`` are excluded from evaluation."""
        fingers = ((bag, namespace) for bag in self.bags for namespace in bag.namespaces)
        return tuple(t for bag, namespace in fingers for t in bag.trials(namespace))

    @property
    def included(self) -> list[Trial]:
        """The trials that are not excluded."""
        return [trial for trial in self.trials if not trial.why_not]

    @property
    def skipped(self) -> list[str]:
        """One sentence for each trial that cannot be used because of its samples."""
        return [trial.why_not for trial in self.trials if trial.is_faulty and trial.why_not]

    @property
    def unit(self) -> str:
        """Unit of all included signals; empty if unknown or not the same for all."""
        trials = self.included or self.trials
        return 'N' if self.is_own else _find_common([t.signal.unit for t in trials]) or ''

    @property
    def rate_hz(self) -> float | None:
        """Sample rate of all included trials [Hz]; None if unknown or not the same for all."""
        if self.is_own and not self._is_even:
            return _find_common(
                [bag.rate_hz(namespace) for bag in self.bags for namespace in bag.namespaces]
            )
        return _find_common([trial.signal.rate_hz for trial in self.included or self.trials])

    @property
    def notes(self) -> list[str]:
        """Sentences on unknown facts, assumptions, processing steps and excluded trials.

        Trials that `skipped` lists are not included.
        """
        unknown = [] if self.unit else ['unit of the signal (--unit N)']
        if not self.is_own and not any(trial.signal.rate_hz for trial in self.trials):
            unknown.append('sample rate (--rate-hz)')
        first = [f'unknown: {", ".join(unknown)}'] if unknown else []
        excluded = [
            f'excluded: trial {trial.name}: {trial.why_not}'
            for trial in self.trials
            if trial.is_excluded
        ]
        return [*first, *self._found.lines, *self._steps, *excluded]

    # -- selection ---------------------------------------------------------------------------

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """Properties of the trials by name, each of shape (trials,).

        ``trial``, ``label``, ``session``, ``mounting``, ``contact``, ``task``, ``simulated``,
        ``source`` and ``why_not`` always exist. Other properties follow, such as
        ``glide_speed_m_s``. If only some trials have a property, its value is None for the others.
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
        # Columns of a file win over the properties that were derived from them.
        for name in dict.fromkeys(name for trial in trials for name in trial.columns):
            if name not in ('trial', 'label', 'why_not'):
                derived = found.get(name, [None] * len(trials))
                pairs = zip(trials, derived, strict=True)
                found[name] = [trial.columns.get(name, value) for trial, value in pairs]
        return {name: _to_column(values) for name, values in found.items()}

    def to_frame(self) -> Any:
        """Return `columns` as a pandas.DataFrame with one row per trial."""
        import pandas  # slow to import

        return pandas.DataFrame(self.columns)

    def select(self, where: Where, option: str = 'select') -> TrialSet:
        """Return a set with some of the trials; both sets read from the same open bags.

        Parameters
        ----------
        where : str, or array_like of bool of shape (trials,)
            ``COLUMN=VALUE[,VALUE...]`` with a name of `columns`, ``COLUMN`` for a boolean column,
            or a mask.
        option : str
            Name of the option in error messages.

        Raises
        ------
        TactileError
            When there is no such column, no trial is selected, or the mask has another shape.
        """
        mask = self._find_mask(where, option)
        return self._change([t for t, is_chosen in zip(self, mask, strict=True) if is_chosen])

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
        mask = self._find_mask(where, 'exclude')
        return self._change(
            [
                replace(trial, why_not=why, is_faulty=False, is_excluded=True)
                if is_chosen
                else trial
                for trial, is_chosen in zip(self, mask, strict=True)
            ]
        )

    def relabel(self, where: Where, label: str) -> TrialSet:
        """Return a set in which some trials have another label; files are not changed.

        ``where`` is as in `select`.
        """
        mask = self._find_mask(where, 'relabel')
        return self._change(
            [
                replace(
                    trial,
                    label=label,
                    why_not=None if trial.why_not == NO_LABEL else trial.why_not,
                )
                if is_chosen
                else trial
                for trial, is_chosen in zip(self, mask, strict=True)
            ]
        )

    def find_window(self, source: str, namespace: str, name: str, start_ns: int) -> Trial | None:
        """Return the trial that contains a window of a bag; None if it is not in this set.

        ``start_ns`` is the start of the window (ROS time) [ns].
        """
        found = [
            trial
            for trial in self.trials
            if (trial.source, trial.namespace, trial.name) == (source, namespace, name)
            and trial.begin_ns is not None
            and trial.begin_ns <= start_ns <= trial.events[-1].stamp_ns
        ]
        return max(found, key=lambda trial: trial.begin_ns or 0, default=None)

    def _find_mask(self, where: Where, option: str) -> NDArray[np.bool_]:
        if isinstance(where, str):
            return select_trials(self.columns, where, option)
        mask = np.asarray(where)
        if mask.shape != (len(self),) or mask.dtype.kind != 'b':
            raise SourceError(
                f'the mask is {mask.dtype} of shape {mask.shape}; it must be bool of shape '
                f'({len(self)},), one per trial'
            )
        if not mask.any():
            raise SourceError('the mask selects no trial')
        return mask

    def _change(self, trials: Sequence[Trial], *steps: str, is_changed: bool = True) -> TrialSet:
        """Return a copy of this set with other trials; ``steps`` are sentences for `notes`."""
        found = copy(self)
        found.trials = tuple(trials)
        found.is_changed = self.is_changed or is_changed
        found._steps = (*self._steps, *steps)  # noqa: SLF001 (of this class)
        return found

    # -- signals -----------------------------------------------------------------------------

    def even(self, *, skip_bad: bool = False, needs_label: bool = True) -> TrialSet:
        """Return a set whose included trials have the same channels and one constant rate.

        Samples of trials with uneven stamps or single lost samples are interpolated linearly.

        Parameters
        ----------
        skip_bad : bool
            Exclude unusable trials; otherwise the first of them raises an error.
        needs_label : bool
            If False, labels may be missing, and constant signals are accepted.

        Raises
        ------
        SourceError
            When rates or channels of the trials differ, a trial is unusable, labels are missing,
            or no trial contains a signal.
        """
        if self._is_even:
            return self
        wanted = [trial for trial in self if trial.is_faulty or not trial.why_not]
        if needs_label and self._found.no_label and not all(trial.label for trial in wanted):
            raise self._found.no_label
        bad = self.skipped
        if bad and not skip_bad:
            raise SourceError(
                f'{len(bad)} of {len(self)} trials cannot be used, first {bad[0]}; --skip-bad '
                'skips such trials'
            )
        included = self.included
        if not included:
            first = next((f', first {trial.why_not}' for trial in self), '')
            raise SourceError(f'{self.name}: no trial of {len(self)} can be used{first}')
        rate_hz = choose_rate(included)
        if self.is_own:  # other recordings were checked when they were read
            faults = [find_time_fault(trial.signal.time_s, rate_hz) for trial in included]
            found = {i: fault for i, fault in enumerate(faults) if fault}
            if found:
                return self.drop(found, skip_bad=skip_bad).even(
                    needs_label=needs_label, skip_bad=True
                )
        signals = {id(trial): make_even(trial.signal, rate_hz) for trial in included}
        _check_channels(list(signals.values()))
        steps = []
        if self._found.rate_from_stamps:
            steps.append(f'rate: {rate_hz:g} Hz, from the stamps')
        names = {name for trial in included for name in trial.columns} - {'label'}
        if lost := sorted(n for n in names if any(n not in t.columns for t in included)):
            steps.append(f'omitted, because some trials lack it: {", ".join(lost)}')
        filled = sum(signals[id(t)].values is not t.signal.values for t in included)
        if filled:
            steps.append(
                f'{filled} of {len(included)} trials have uneven stamps or lost samples: '
                f'interpolated linearly to an even {rate_hz:g} Hz'
            )
        if needs_label:
            named = [(trial.name, signals[id(trial)]) for trial in included]
            steps += _find_doubts(self.name, named)
        whole = self._change(
            [_with_signal(t, signals[id(t)]) if id(t) in signals else t for t in self],
            *steps,
            is_changed=False,
        )
        whole._is_even = True  # noqa: SLF001 (of this class)
        return whole

    def resample(self, rate_hz: float) -> TrialSet:
        """Return a set at another rate [Hz]; see `sources.signals.resample`."""
        whole = self.even()
        own_hz = whole.rate_hz
        assert own_hz is not None, 'the set is even'
        if own_hz == rate_hz:
            return whole
        up, down = find_ratio(own_hz, rate_hz)
        values = sum(trial.signal.values.size for trial in whole.included)
        if 8 * values * up / down > MAX_BYTES:
            raise SourceError(f'at {rate_hz:g} Hz the trials exceed the memory limit')
        return whole._map(  # noqa: SLF001 (of this class)
            lambda signal: resample(signal, rate_hz),
            f'resampled from {own_hz:g} to {rate_hz:g} Hz: polyphase filter {up}/{down} '
            'against aliasing, scipy.signal.resample_poly, Kaiser 5.0',
        )

    def crop(self, start_s: float, stop_s: float, *, skip_bad: bool = False) -> TrialSet:
        """Return a set with the samples from ``start_s`` to before ``stop_s`` of each trial.

        If ``skip_bad`` is True, trials that end before ``stop_s`` are excluded; otherwise, they
        raise SourceError. SourceError is also raised if all trials are shorter, or if no sample
        remains.
        """
        whole = self.even(skip_bad=skip_bad)
        rate_hz = whole.included[0].signal.rate_hz
        assert rate_hz is not None, 'the set is even'
        counts = [trial.signal.values.shape[1] for trial in whole.included]
        longest = max(counts)
        first, last = (round(t * rate_hz, 6) for t in (start_s, stop_s))
        if not 0 <= first < last <= longest:
            raise SourceError(
                f'the trials last {longest / rate_hz:.6g} s; {start_s:g} to {stop_s:g} s is '
                'outside'
            )
        begin, end = math.ceil(first), math.ceil(last)
        if begin == end:
            raise SourceError(
                f'there is no sample from {start_s:g} to {stop_s:g} s at {rate_hz:g} Hz'
            )
        bad = {
            i: f'it lasts {count / rate_hz:.6g} s; {stop_s:g} s are needed'
            for i, count in enumerate(counts)
            if count < last
        }
        kept = whole.drop(bad, skip_bad=skip_bad)
        return kept._map(lambda signal: _cut(signal, begin, end))  # noqa: SLF001 (of this class)

    def cut_to_shortest(self) -> TrialSet:
        """Return a set in which all trials have the length of the shortest, from their start."""
        whole = self.even()
        included = whole.included
        counts = [trial.signal.values.shape[1] for trial in included]
        shortest, rate_hz = min(counts), included[0].signal.rate_hz
        if shortest == max(counts):
            return whole
        assert rate_hz is not None, 'the set is even'
        return whole._map(  # noqa: SLF001 (of this class)
            lambda signal: _cut(signal, 0, shortest),
            f'cut to the first {shortest / rate_hz:.6g} s, the length of the shortest trial '
            f'({included[counts.index(shortest)].name})',
        )

    def drop(self, bad: Mapping[int, str], *, skip_bad: bool) -> TrialSet:
        """Exclude unusable trials; ``bad`` maps indices in `included` to reasons.

        Raises SourceError if ``skip_bad`` is not set, or no trial remains.
        """
        if not bad:
            return self
        included = self.included
        reasons = {
            id(included[i]): f'trial {included[i].name}: {reason}' for i, reason in bad.items()
        }
        if not skip_bad or len(bad) == len(included):
            remedy = '' if skip_bad else '; --skip-bad skips such trials'
            raise SourceError(
                f'{len(bad)} of {len(included)} trials cannot be used, first '
                f'{next(iter(reasons.values()))}{remedy}'
            )
        return self._change(
            [
                replace(trial, why_not=reasons[id(trial)], is_faulty=True)
                if id(trial) in reasons
                else trial
                for trial in self
            ],
            is_changed=False,
        )

    def add_step(self, sentence: str) -> TrialSet:
        """Return a copy of this set with another sentence on its processing in `notes`."""
        return self._change(self.trials, sentence, is_changed=False)

    def _map(self, change: Callable[[Signal], Signal], *steps: str) -> TrialSet:
        """Return a set with changed signals of the included trials."""
        found = self._change(
            [t if t.why_not else _with_signal(t, change(t.signal)) for t in self],
            *steps,
            is_changed=False,
        )
        found.has_new_signals = True
        return found

    # -- conversions -------------------------------------------------------------------------

    def windows(
        self, group: str = ''
    ) -> tuple[NDArray[np.float64], NDArray[np.str_], NDArray[Any] | None]:
        """Return signals, labels and groups of the included trials, as scikit-learn needs them.

        Longer trials are cut to the length of the shortest; cut them with `crop` first.

        Parameters
        ----------
        group : str
            Column of the groups, such as ``session_id``; without one, the groups are None.

        Returns
        -------
        x : ndarray of float64, shape (trials, channels, samples)
        y : ndarray of str, shape (trials,)
        groups : ndarray of shape (trials,), or None

        Raises
        ------
        SourceError
            See `even`.
        """
        found = self.cut_to_shortest()
        x = np.stack([trial.signal.values for trial in found.included])
        y = np.array([trial.label for trial in found.included])
        if not group:
            return x, y, None
        chosen = np.array([not trial.why_not for trial in found])
        columns = found.columns
        name = find_column(columns, group)
        if name not in columns:
            raise SourceError(f'there is no column "{group}"; there are: {", ".join(columns)}')
        return x, y, columns[name][chosen]

    def save(self, path: str | Path) -> None:
        """Write the included trials to an archive (``.npz``) that `load` reads; replace a file.

        Raises
        ------
        SourceError
            See `even`.
        """
        from tactile_analysis.sources.arrays import write_archive

        if Path(path).suffix != '.npz':
            raise SourceError(f'{path}: the name of an archive must end in .npz')
        named = self.even().name_trials()
        signals = [trial.signal for trial, _ in named]
        lengths = np.array([signal.values.shape[1] for signal in signals])
        channels = signals[0].channels
        x = np.zeros((len(signals), len(channels), int(lengths.max())))
        for row, signal in enumerate(signals):
            x[row, :, : lengths[row]] = signal.values
        columns = join_columns(named)
        arrays = {f'{n}_' if n in RESERVED else n: column for n, column in columns.items()}
        arrays |= {'x': x, 'rate_hz': np.array(signals[0].rate_hz)}
        if unit := self.unit:
            arrays['unit'] = np.array(unit)
        if len(channels) > 1:
            arrays['channel_names'] = np.array(channels)
        if (lengths != lengths[0]).any():
            arrays['length'] = lengths
        write_archive(Path(path), arrays)

    def name_trials(self) -> list[tuple[Trial, str]]:
        """Return the included trials, each with a unique name."""
        counting = self.included
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

        # Only archives state a rate. In other recordings, it follows from the times.
        is_stated = self.kind == SourceKind.ARCHIVE.value
        return build_long_table(self.name_trials(), self.rate_hz if is_stated else None)


def _with_signal(trial: Trial, signal: Signal) -> Trial:
    return replace(trial, load_signal=lambda: signal)


def _cut(signal: Signal, begin: int, end: int) -> Signal:
    time_s = signal.time_s
    assert time_s is not None, 'the set is even'
    return replace(
        signal, time_s=time_s[begin:end] - time_s[begin], values=signal.values[:, begin:end]
    )


def _to_column(values: Sequence[Any]) -> NDArray[Any]:
    return np.array(values, dtype=object if any(value is None for value in values) else None)


def _find_common(values: Sequence[Value]) -> Value | None:
    """Return the first value if all values are equal, otherwise None."""
    return values[0] if values and len(set(values)) == 1 else None


def _check_channels(signals: Sequence[Signal]) -> None:
    counts = {len(signal.values) for signal in signals}
    if len(counts) > 1:
        raise SourceError(
            f'the trials have {" and ".join(map(str, sorted(counts)))} channels; '
            'all must have the same number'
        )
    names = list(dict.fromkeys(signal.channels for signal in signals))
    if len(names) > 1 and counts != {1}:
        raise SourceError(
            f'the channels of the trials differ: {", ".join(names[0])}, and '
            f'{", ".join(names[1])}; state them with --force-column or --field'
        )


def _find_doubts(name: str, trials: Sequence[tuple[str, Signal]]) -> Iterator[str]:
    """Yield warnings about usable trials; raise SourceError if no trial contains a signal."""
    signals = [signal.values for _, signal in trials]
    constant = np.array([(x == x[:, :1]).all(axis=1) for x in signals])
    if constant.all():
        raise SourceError(f'{name}: all trials are constant and contain no signal')
    if len(signals) > 1 and all(np.array_equal(signals[0], x) for x in signals[1:]):
        raise SourceError(
            f'{name}: all {len(signals)} trials contain the same samples: check the selected '
            'columns, and the separator of a text table'
        )
    names = np.array([each for each, _ in trials])
    for channel, flat in zip(trials[0][1].channels, constant.T, strict=True):
        if flat.any():
            yield f'warning: channel {channel} is constant in {_name_trials(names[flat])}'
    counts = np.array([x.shape[1] for x in signals])
    if (counts < FEW_SAMPLES).any():
        yield (
            f'warning: fewer than {FEW_SAMPLES} samples in '
            f'{_name_trials(names[counts < FEW_SAMPLES])}, the fewest {counts.min()}'
        )


def _name_trials(names: Sequence[str] | NDArray[Any]) -> str:
    more = f' and {len(names) - 5} more' if len(names) > 5 else ''
    return f'{len(names)} trial{"s" if len(names) > 1 else ""} ({", ".join(names[:5])}{more})'


def _open_own(leaves: Sequence[SourceFile], options: SourceOptions) -> list[RecordedBag]:
    """Open and return the bags that have trial events.

    If ``options.topic`` is set, no bags are opened, because they are read like recordings of other
    software.
    """
    if options.topic or not any(leaf.kind is SourceKind.BAG for leaf in leaves):
        return []
    from tactile_bags.recorded_bag import correct_bags, RecordedBag  # imports rosbags

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
        if own and options != SourceOptions():
            raise SourceError(
                f'{own[0].path} contains trial events, which define the trials: omit '
                '--force-column, --rate-hz, --label, --label-from, --labels and --field'
            )
        correct_bags(own)
        stack.pop_all()
    return own


def _read_others(
    kind: SourceKind, leaves: Sequence[SourceFile], options: SourceOptions, notes: ImportNotes
) -> list[Trial]:
    """Return the trials of recordings of other software."""
    if kind is SourceKind.TABLE:
        from tactile_analysis.sources.table_trials import read_table_trials  # slow to import

        return read_table_trials(leaves, options, notes)
    if kind is SourceKind.BAG:
        from tactile_analysis.sources.other_bags import read_bag_trials

        return read_bag_trials(leaves, options, notes)
    from tactile_analysis.sources.arrays import read_archive_trials, read_array_trials

    if kind is SourceKind.ARRAY:
        return read_array_trials(leaves, options, notes)
    if len(leaves) > 1:
        raise SourceError(f'take one archive at a time, not {_examples(leaves)}')
    return read_archive_trials(leaves[0], options, notes)


def _examples(leaves: Sequence[SourceFile]) -> str:
    return ', '.join({leaf.kind: leaf.name for leaf in leaves}.values())


def select_trials(columns: Columns, text: str, option: str) -> NDArray[np.bool_]:
    """Return a mask of the trials that meet a condition.

    ``text`` is ``COLUMN=VALUE[,VALUE...]``, or the name of a column that must be True.
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
        chosen = np.array([value is not None for value in column])
        known = np.array(column[chosen].tolist()) if column.dtype == object else column
        wanted = [_value(v, known, name, option) for v in values.split(',')]
        chosen[chosen] = np.isin(known, wanted)
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
