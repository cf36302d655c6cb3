# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""`tactile compare`: which of two models is better on the same trials, with paired intervals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
import time
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.evaluation.model_comparison import Answered, compare_answers, Comparison
from tactile_classifier.model_file.inference import TactileModel
from tactile_classifier.model_file.trial_answers import find_training_trials, name_trials
from tactile_classifier.records import NO_ANSWER, UNKNOWN
from tactile_lab.commands.analysis.model_pairs import (
    Contender,
    load_models,
    pair_models,
    question_of,
    SIDES,
)
from tactile_lab.commands.analysis.requests import CompareRequest
from tactile_lab.commands.output import Output
from tactile_lab.datasets.paired_tables import (
    bag_reader,
    pair_tables,
    PairedTrials,
    Reader,
    trial_reader,
)
from tactile_lab.datasets.sources.load import split_sources
from tactile_lab.datasets.tables import tell_interval
from tactile_lab.experiment.folder import list_recordings
from tactile_ros.errors import TactileError

TIMED = 200
"""Answers of each model that are timed at most."""

CONFUSIONS = 5
"""Confusions in the terminal; JSON has all."""


@dataclass(frozen=True)
class Compared:
    """Two models on the trials of one task and contact.

    Attributes
    ----------
    title : str
    contenders : (Contender, Contender)
    comparison : Comparison
    seen : (int or None, int or None)
        Trials that were in the training of each; None: its file does not tell.
    left_out : str
        Trials that do not count, in words; empty: none.
    beside_seen : int
        With trials of the training left out: trials that share a session with these.
    new_labels : dict
        Of trials with labels that the models do not know: how many, and the share of them that
        each calls unknown; empty: there are none.
    seconds : (float, float)
        Median time of one answer [s].
    """

    title: str
    contenders: tuple[Contender, Contender]
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
        return _tell_verdict(self.comparison, caution)

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


def run_compare(request: CompareRequest, *, as_json: bool) -> None:
    """Compare the models of two files or folders, and print what came out.

    Raises
    ------
    TactileError
        When models and recordings do not go together.
    """
    output = Output(as_json)
    pairs, alone = pair_models(*map(load_models, (request.model_a, request.model_b)))
    own, leaves = split_sources(list_recordings(request.recordings), request.sources)
    if leaves:
        tasks = Counter(a.model.task for a, _ in pairs)
        if max(tasks.values()) > 1:
            raise TactileError(
                f'{request.model_a} and {request.model_b} have several models for one task, '
                'and these recordings do not state the contact: name two model files'
            )
        read = trial_reader(leaves, request)
    else:
        request.check_for_bags()
        read = bag_reader(own)
    columns = [name.strip() for name in (request.group or '').split(',') if name.strip()]
    found = []
    with output.progress('comparing') as show:
        for number, pair in enumerate(pairs, 1):
            compared = compare_pair(read, pair, columns, unseen=request.unseen)
            if not compared:
                alone.append(f'no labelled trials of {question_of(pair)} in these recordings')
            found += compared
            show(number, len(pairs))
    if not found:
        raise TactileError('; '.join(alone))
    for each in found:
        _print(each, output)
    for sentence in alone:
        output.say(sentence, plain=True)
    output.result({'comparisons': [each.to_dict() for each in found], 'left_out': alone})


def compare_pair(
    read: Reader, pair: tuple[Contender, Contender], columns: list[str], *, unseen: bool
) -> list[Compared]:
    """Compare two models on the trials of each contact that both are for.

    Raises
    ------
    TactileError
        When no trial is left.
    """
    models = (pair[0].model, pair[1].model)
    return [_compare(pair, paired, unseen=unseen) for paired in pair_tables(read, models, columns)]


def _compare(pair: tuple[Contender, Contender], paired: PairedTrials, *, unseen: bool) -> Compared:
    models = (pair[0].model, pair[1].model)
    answers = [
        paired.spread(i, name_trials(model, paired.tables[i].values), NO_ANSWER)
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


def _print(compared: Compared, output: Output) -> None:
    comparison = compared.comparison
    sides = (comparison.a, comparison.b)
    table = Table(title=compared.title, title_justify='left', title_style='bold')
    table.add_column('')
    for side, each in zip(SIDES, compared.contenders, strict=True):
        table.add_column(f'{side}: {each.title}', justify='right')
    table.add_row('features', *(each.model.spec.feature_set for each in compared.contenders))
    for name, tell in _ROWS.items():
        table.add_row(name, *(tell(side) for side in sides))
    table.add_row('only this one is right', str(comparison.only_a), str(comparison.only_b))
    table.add_row('file', *(f'{each.size_bytes / 1024:.0f} KiB' for each in compared.contenders))
    output.say(table)
    for side, each in zip(SIDES, compared.contenders, strict=True):
        output.say(f'  {side}: {each.path}', plain=True)
    ratio = compared.seconds[1] / compared.seconds[0]
    output.say(f'  {_tell_difference(comparison)}')
    output.say(f'  same answer: {100 * comparison.agreement:.1f} % of the trials')
    output.say(f'  time of one answer, B to A, features apart: {ratio:.2f}')
    for wrong in comparison.confusions[:CONFUSIONS]:
        output.say(
            f'  {wrong.label}: {wrong.answer} is the answer of A in {wrong.count_a}, of B in '
            f'{wrong.count_b} of {wrong.trials} trials',
            plain=True,
        )
    if compared.new_labels:
        new: Mapping[str, Any] = compared.new_labels
        output.say(
            f'  labels that neither knows ({", ".join(new["labels"])}; {new["trials"]} trials, '
            f'not counted above): unknown to A {100 * new["unknown_rate_a"]:.0f} %, to B '
            f'{100 * new["unknown_rate_b"]:.0f} %',
            plain=True,
        )
    if compared.left_out:
        output.say(f'  {compared.left_out}')
    for warning in compared.warnings:
        output.say(f'  warning: {warning}', plain=True)
    output.say(compared.verdict)
    output.say()


def _tell_verdict(comparison: Comparison, caution: str = '') -> str:
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


def _tell_difference(comparison: Comparison) -> str:
    """Return where the interval of the difference comes from."""
    if comparison.interval.reason:
        return f'difference: no interval, {comparison.interval.reason}'
    over = comparison.interval.method
    if over.startswith('t over'):
        return f'difference: 95 % interval, {over}; shares are means over these'
    return f'difference: 95 % interval, {over}; p {comparison.p_value:.2g} (McNemar)'


def _tell_accuracy(side: Answered) -> str:
    accuracy = f'{100 * side.accuracy:.1f} %'
    return accuracy if side.interval.reason else f'{accuracy}  ({tell_interval(side.interval)})'


def _tell_answered(side: Answered) -> str:
    share = side.answered_accuracy
    return 'it gives none' if share is None else f'{100 * share:.1f} %'


_ROWS: Mapping[str, Callable[[Answered], str]] = MappingProxyType(
    {
        'named correctly': _tell_accuracy,
        'right, where it gives a label': _tell_answered,
        'unknown': lambda side: f'{100 * side.unknown_rate:.1f} %',
        'no answer': lambda side: f'{100 * side.no_answer_rate:.1f} %',
    }
)
"""Rows of the table: what each says of one model."""
