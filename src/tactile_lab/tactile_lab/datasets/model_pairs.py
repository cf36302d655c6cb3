# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two models that answer the same question, compared on the same trials."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import json
from pathlib import Path
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_bags.recording import Recording
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.evaluation.model_comparison import compare_answers, Comparison
from tactile_classifier.model_file.model import find_training_trials, load_model, TactileModel
from tactile_classifier.records import CLASSIFIER_TITLES, NO_ANSWER, short_scaling, UNKNOWN
from tactile_features.model_contract import read_contracts
from tactile_lab.datasets.feature_tables import (
    features_of,
    FeatureTables,
    Key,
    RecordingFeatures,
)
from tactile_lab.datasets.reading import Reading
from tactile_ros.errors import TactileError

SIDES = ('A', 'B')

TIMED = 200
"""Answers of each model that are timed at most."""

SESSION = 'session_id'

Reader = Callable[[TactileModel], FeatureTables]
"""Returns the tables of some recordings, with the features that a model takes."""


@dataclass(frozen=True)
class Contender:
    """One of the two models."""

    path: Path
    model: TactileModel

    @property
    def title(self) -> str:
        manifest = self.model.manifest
        return f'{CLASSIFIER_TITLES[manifest.classifier]}, {short_scaling(manifest.scaling)}'

    @property
    def size_bytes(self) -> int:
        return self.path.stat().st_size


Pair = tuple[Contender, Contender]


def load_models(
    path: Path, task: str | None = None, contact: str | None = None
) -> list[Contender]:
    """Return the models of a file or folder; of one task and contact where these are named.

    Raises `TactileError` or `ModelFileError` when there is none, or a file of a folder cannot be
    used.
    """
    contracts, refused = read_contracts(path)
    if refused:
        raise TactileError('; '.join(refused))
    models = [Contender(each.path, load_model(each.path)) for each in contracts]
    found = [
        each
        for each in models
        if task in (None, each.model.task) and contact in (None, '', each.model.contact)
    ]
    if not found:
        wanted = ', '.join(filter(None, (task, contact)))
        known = '; '.join(_question(each.model) for each in models)
        raise TactileError(f'{path} has no model for {wanted}; it has models for {known}')
    return found


def pair_models(
    models_a: list[Contender], models_b: list[Contender]
) -> tuple[list[Pair], list[str]]:
    """Return the models that answer the same question, and a sentence for each other one.

    Raises `TactileError` when there is no pair, or a pair has other labels.
    """
    pairs = [
        (a, b)
        for a in models_a
        for b in models_b
        if a.model.task == b.model.task and len({a.model.contact, b.model.contact} - {''}) < 2
    ]
    if not pairs:
        answers = (
            ', '.join(_question(each.model) for each in models) for models in (models_a, models_b)
        )
        raise TactileError(
            'the models answer different questions, so there is nothing to compare: A answers '
            f'{" and B ".join(answers)}'
        )
    for a, b in pairs:
        sets = [set(each.model.labels) for each in (a, b)]
        only = [', '.join(sorted(mine - other)) for mine, other in (sets, sets[::-1])]
        if any(only):
            raise TactileError(
                f'the models for {_question(a.model)} know different labels: only A knows '
                f'{only[0] or "none"}, only B {only[1] or "none"}. Train both on the same labels'
            )
    paired = [each for pair in pairs for each in pair]
    alone = [
        f'only {side} has a model for {_question(each.model)}: not compared'
        for side, models in zip(SIDES, (models_a, models_b), strict=True)
        for each in models
        if each not in paired
    ]
    return pairs, alone


def question_of(pair: Pair) -> str:
    """Return the task of a pair, and the contact where one is for it alone."""
    return max((_question(each.model) for each in pair), key=len)


def _question(model: TactileModel) -> str:
    return ', '.join(filter(None, (model.task, model.contact)))


def reader_of(recording: Recording, reading: Reading, pairs: Sequence[Pair]) -> Reader:
    """Return what gives the tables of a recording for a model, each set of features once.

    Raises `TactileError` when options and recording do not fit; or several models answer one task,
    and the recording does not state the contact.
    """
    if not recording.is_own and max(Counter(a.model.task for a, _ in pairs).values()) > 1:
        raise TactileError(
            f'there are several models for one task, and {recording.name} does not state the '
            'contact: name it with --contact, or two model files'
        )
    sources: dict[str, RecordingFeatures] = {}
    found: dict[str, FeatureTables] = {}

    def read(model: TactileModel) -> FeatureTables:
        task, values = '', model.spec.config_values()
        wanted = reading
        if not recording.is_own:  # which do not state a task
            task = model.task
            wanted = replace(reading, task=task, features=model.spec.feature_set)
        if task not in sources:
            sources[task] = features_of(recording, wanted)
        name = json.dumps([task, values], sort_keys=True)
        if name not in found:
            found[name] = sources[task].tables(values)
        return found[name]

    return read


@dataclass(frozen=True)
class PairedTrials:
    """Trials that give features for one model at least.

    ``key``: task and contact. ``labels``, ``trial_ids`` (ndarray of str, shape (trials,)).
    ``groups`` (ndarray of str, shape (trials,), or None). ``parts_are``: what the groups are, in
    the plural. ``simulated`` (ndarray of bool, shape (trials,)). ``tables``: features for A and
    for B. ``rows`` ((ndarray, ndarray) of int, shape (trials,)): where each trial stands in these
    tables; -1: it gives this model no features.
    """

    key: Key
    labels: NDArray[np.str_]
    trial_ids: NDArray[np.str_]
    groups: NDArray[np.str_] | None
    parts_are: str
    simulated: NDArray[np.bool_]
    tables: tuple[FeatureTable, FeatureTable]
    rows: tuple[NDArray[np.intp], NDArray[np.intp]]

    def __len__(self) -> int:
        return len(self.labels)

    def take(self, keep: NDArray[np.bool_]) -> PairedTrials:
        """Return some of the trials."""
        return replace(
            self,
            labels=self.labels[keep],
            trial_ids=self.trial_ids[keep],
            groups=None if self.groups is None else self.groups[keep],
            simulated=self.simulated[keep],
            rows=(self.rows[0][keep], self.rows[1][keep]),
        )

    def spread(self, side: int, of_table: NDArray[Any], missing: Any) -> NDArray[Any]:
        """Return what stands for each row of a model's table, for each trial.

        ``side``: 0: A; 1: B. ``of_table`` (ndarray of shape (rows of the table,)). ``missing``:
        for trials without features.
        """
        rows = self.rows[side]
        return np.array([missing if row < 0 else of_table[row] for row in rows])


def pair_tables(
    read: Reader, models: tuple[TactileModel, TactileModel], columns: Sequence[str]
) -> list[PairedTrials]:
    """Return the trials that both models are for, by contact; none: there are no such trials.

    ``read``: see `Reader`. ``columns``: columns that make a group; none: the session, where there
    is one.

    Raises `DatasetError` when the recordings lack a column. Raises `ModelFileError` when the
    features of the recordings are not those that a model takes.
    """
    found = [_fitting(read(model), models) for model in models]
    paired = []
    for key in found[0]:
        if key not in found[1]:
            continue
        tables = (found[0][key], found[1][key])
        for model, table in zip(models, tables, strict=True):
            model.check_fits(table.spec)
        paired.append(_pair(key, tables, columns))
    return paired


def _fitting(
    read: FeatureTables, models: tuple[TactileModel, TactileModel]
) -> Mapping[Key, FeatureTable]:
    contacts = {model.contact for model in models}
    return {
        key: table
        for key, table in read.tables.items()
        if key[0] == models[0].task and len((contacts | {key[1]}) - {''}) < 2
    }


def _pair(
    key: Key, tables: tuple[FeatureTable, FeatureTable], columns: Sequence[str]
) -> PairedTrials:
    places = [_places(table) for table in tables]
    trials = [*places[0], *(name for name in places[1] if name not in places[0])]
    rows = tuple(np.array([place.get(name, -1) for name in trials]) for place in places)
    sources = [(0, a) if a >= 0 else (1, b) for a, b in zip(*rows, strict=True)]

    def join(*both: NDArray[Any]) -> NDArray[Any]:
        return np.array([both[side][row] for side, row in sources])

    groups = None
    present = [SESSION] if SESSION in tables[0].columns else []
    for name in columns or present:
        values = join(*(table.column(name).astype(str) for table in tables))
        groups = values if groups is None else np.char.add(np.char.add(groups, '/'), values)
    return PairedTrials(
        key,
        labels=join(*(table.labels for table in tables)),
        trial_ids=join(*(table.column('trial_id').astype(str) for table in tables)),
        groups=groups,
        parts_are=f'groups of {" and ".join(columns)}' if columns else 'sessions',
        simulated=join(*(_optional(table, 'simulated').astype(bool) for table in tables)),
        tables=tables,
        rows=(rows[0], rows[1]),
    )


def _optional(table: FeatureTable, name: str) -> NDArray[Any]:
    """Return a column, zeros where there is none."""
    return np.asarray(table.columns.get(name, np.zeros(len(table))))


def _places(table: FeatureTable) -> dict[tuple[str, ...], int]:
    """Return the row of each trial; a trial's name may come again, so its turn counts too."""
    source = [_optional(table, name).astype(str) for name in ('bag', 'namespace', 'trial_id')]
    turns: defaultdict[tuple[str, ...], int] = defaultdict(int)
    places = {}
    for row, name in enumerate(zip(*source, strict=True)):
        turns[name] += 1
        places[(*name, str(turns[name]))] = row
    return places


@dataclass(frozen=True)
class Compared:
    """Two models on the trials of one task and contact.

    ``seen``: trials that were in the training of each; None: its file does not tell. ``left_out``:
    trials that do not count, in words; empty: none. ``beside_seen``: with trials of the training
    left out: trials that share a session with these. ``new_labels``: of trials with labels that
    the models do not know: how many, and the share of them that each calls unknown; empty: there
    are none. ``seconds``: median time of one answer [s].
    """

    title: str
    contenders: Pair
    comparison: Comparison
    seen: tuple[int | None, int | None]
    left_out: str
    beside_seen: int
    new_labels: dict[str, Any]
    seconds: tuple[float, float]

    @property
    def warnings(self) -> list[str]:
        """Warnings about bias in the comparison, one sentence each."""
        found = []
        for side, seen in zip(SIDES, self.seen, strict=True):
            if seen:
                found.append(
                    f'{seen} of these {self.comparison.trials} trials were in the training of '
                    f'{side}, which favours it; --unseen leaves them out'
                )
        if self.beside_seen:
            found.append(
                f'{self.beside_seen} of these trials share one of the {self.comparison.parts_are} '
                'with trials that a model was trained on; new ones may differ more'
            )
        silent = [s for s, seen in zip(SIDES, self.seen, strict=True) if seen is None]
        if silent:
            found.append(f'whether {" and ".join(silent)} has seen these trials is not known')
        if not self.comparison.groups:
            found.append(
                'the trials are of one session, or it is not stated: another session may differ '
                'more than the interval says'
            )
        return found

    @property
    def verdict(self) -> str:
        """One sentence that states the better side, the difference and the trials."""
        trained_on = [s for s, seen in zip(SIDES, self.seen, strict=True) if seen]
        was = 'were' if len(trained_on) > 1 else 'was'
        caution = f', on trials that {" and ".join(trained_on)} {was} trained on'
        caution *= bool(trained_on)
        return _format_verdict(self.comparison, caution)

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold."""
        return {
            'title': self.title,
            'models': {
                side.lower(): {
                    'path': str(each.path),
                    'model_id': each.model.model_id,
                    'feature_set': each.model.spec.feature_set,
                    'size_bytes': each.size_bytes,
                    'predict_s': seconds,
                    'training_trials_among_these': seen,
                }
                for side, each, seconds, seen in zip(
                    SIDES, self.contenders, self.seconds, self.seen, strict=True
                )
            },
            'predict_time_ratio_b_to_a': self.seconds[1] / self.seconds[0],
            **self.comparison.to_dict(),
            'left_out': self.left_out,
            'trials_in_sessions_of_the_training': self.beside_seen,
            'new_labels': self.new_labels,
            'warnings': self.warnings,
            'verdict': self.verdict,
        }


def compare_pair(
    read: Reader, pair: Pair, columns: Sequence[str], *, unseen: bool
) -> list[Compared]:
    """Compare two models on the trials of each contact that both are for.

    Raises `TactileError` when no trial is left.
    """
    models = (pair[0].model, pair[1].model)
    return [_compare(pair, paired, unseen=unseen) for paired in pair_tables(read, models, columns)]


def _compare(pair: Pair, paired: PairedTrials, *, unseen: bool) -> Compared:
    models = (pair[0].model, pair[1].model)
    answers = [
        paired.spread(i, model.predict(paired.tables[i].values), NO_ANSWER)
        for i, model in enumerate(models)
    ]
    seen = [_find_seen(model, paired.tables[i], paired, i) for i, model in enumerate(models)]
    name = ', '.join(filter(None, paired.key))
    is_known = np.isin(paired.labels, models[0].labels)
    new_labels = _count_new(paired, ~is_known, answers)
    keep, left_out, beside_seen = is_known, '', 0
    if unseen:
        for each, found in zip(pair, seen, strict=True):
            if found is None:
                raise TactileError(
                    f'--unseen: {each.path} does not tell which trials it was trained on; leave '
                    'the option out'
                )
        trained_on = np.any(np.array(seen), axis=0)
        left_out = f'{trained_on[keep].sum()} trials that a model was trained on are left out'
        keep = keep & ~trained_on
        if paired.groups is not None:
            beside_seen = int(np.isin(paired.groups[keep], paired.groups[trained_on]).sum())
    if not keep.any():
        labels = ', '.join(np.unique(paired.labels))
        raise TactileError(
            f'{name}: a model was trained on each of these trials, so none is left'
            if is_known.any()
            else f'{name}: no trial has a label that the models know: the trials have {labels}, '
            f'the models know {", ".join(models[0].labels)}'
        )
    counted = paired.take(keep)
    simulated = ', SIMULATED' if counted.simulated.any() else ''
    return Compared(
        title=f'{name}{simulated}',
        contenders=pair,
        comparison=compare_answers(
            counted.labels,
            answers[0][keep],
            answers[1][keep],
            groups=counted.groups,
            parts_are=counted.parts_are,
        ),
        seen=tuple(None if each is None else int(each[keep].sum()) for each in seen),  # type: ignore[arg-type]
        left_out=left_out,
        beside_seen=beside_seen,
        new_labels=new_labels,
        seconds=time_answers(models, paired.tables),
    )


def _find_seen(
    model: TactileModel, table: FeatureTable, paired: PairedTrials, side: int
) -> NDArray[np.bool_] | None:
    """Return which trials were in the training of a model; None: its file does not tell."""
    if table.compute_sha256() == model.manifest.training_sha256:
        found: NDArray[np.bool_] | None = np.ones(len(table), dtype=bool)
    else:
        found = find_training_trials(model, table.values)
    return None if found is None else paired.spread(side, found, False)


def _count_new(
    paired: PairedTrials, is_new: NDArray[np.bool_], answers: list[NDArray[Any]]
) -> dict[str, Any]:
    if not is_new.any():
        return {}
    return {
        'trials': int(is_new.sum()),
        'labels': np.unique(paired.labels[is_new]).tolist(),
        'unknown_rate_a': float((answers[0][is_new] == UNKNOWN).mean()),
        'unknown_rate_b': float((answers[1][is_new] == UNKNOWN).mean()),
    }


def time_answers(
    models: tuple[TactileModel, TactileModel], tables: tuple[FeatureTable, FeatureTable]
) -> tuple[float, float]:
    """Return the median time of one answer of each model [s].

    The models take turns, so that whatever else the computer does slows both.
    """
    taken_ns: tuple[list[int], list[int]] = ([], [])
    for i in range(TIMED):
        for model, table, taken in zip(models, tables, taken_ns, strict=True):
            row = table.values[i % len(table)][np.newaxis]
            begin_ns = time.perf_counter_ns()
            model.compute(row)
            taken.append(time.perf_counter_ns() - begin_ns)
    return float(np.median(taken_ns[0])) * 1e-9, float(np.median(taken_ns[1])) * 1e-9


def _format_verdict(comparison: Comparison, caution: str = '') -> str:
    """Return which model is better, by how much and on what, in one sentence."""
    over = f'{comparison.trials} trials{caution}'
    if comparison.groups:
        over = f'{comparison.groups} {comparison.parts_are}, {over}'
    interval = comparison.interval
    if interval.reason:
        return f'Not told apart: {interval.reason}; {over}.'
    points, low, high = (100 * n for n in (comparison.difference, interval.low, interval.high))
    if not comparison.better:
        span = f'{points:+.1f} points ({low:+.1f} to {high:+.1f})'
        return f'Not told apart: B less A is {span}, {over}.'
    if comparison.better == 'A':
        points, low, high = -points, -high, -low
    return (
        f'{comparison.better} is better by {points:.1f} points ({low:.1f} to {high:.1f}), {over}.'
    )
