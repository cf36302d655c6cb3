# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""`tactile evaluate`: cross-validated accuracy on archives and bags, and the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_classifier.datasets.archive import LabelledTrials, load_archive
from tactile_classifier.datasets.dataset import (
    ALL,
    Channel,
    FeatureTable,
    table_from_trials,
    usable_table,
)
from tactile_classifier.evaluation.cross_validation import evaluate, Evaluation
from tactile_features.config import FeatureConfig
from tactile_features.feature_sets.stiffness_regression import StiffnessRegression
from tactile_features.feature_sets.stiffness_relaxation import StiffnessRelaxation
from tactile_features.feature_sets.texture_spectrum import TextureSpectrum
from tactile_features.records import PHASE_GLIDE, PROTOCOL_TEXTURE
from tactile_lab.commands.features import choose_features, list_sets
from tactile_lab.commands.output import Output
from tactile_lab.datasets.bag_tables import read_tables
from tactile_lab.datasets.selection import select_trials, TrainTest
from tactile_lab.datasets.tables import (
    accuracy_caption,
    accuracy_table,
    describe_features,
    tell_warnings,
)
from tactile_lab.experiment.folder import list_recordings
from tactile_lab.report.analysis import analyse, SetResult
from tactile_lab.report.build import report_path, write_report
from tactile_lab.report.recordings import array_examples, bag_sets, RecordingSet
from tactile_lab.report.sentences import summarise_set
from tactile_ros.errors import TactileError

PAPER: Mapping[str, Any] = MappingProxyType(
    {**TextureSpectrum.unstated, 'stiffness_features': StiffnessRegression.name}
)
"""The paper's features of its own windows, by the fields of `FeatureConfig`."""


@dataclass(frozen=True)
class EvaluateRequest:
    """The arguments of `tactile evaluate`; see its ``--help``."""

    recordings: tuple[Path, ...]
    task: str | None
    channel: str | None
    where: str | None
    crop: str | None
    groups: tuple[str, ...]
    folds: int
    repetitions: int
    features: str | None
    seed: int
    report: Path | None = None
    over: str | None = None
    speed_column: str | None = None
    detrend: str | None = None
    answers: bool = False
    train_where: str | None = None
    test_where: str | None = None
    resample_hz: float | None = None
    skip_bad: bool = False

    @property
    def train_test(self) -> TrainTest:
        """The stated split into trials to train on and to test on."""
        return TrainTest(self.train_where, self.test_where)

    @property
    def hold_out(self) -> tuple[tuple[str, ...], ...]:
        """The columns of each grouped split."""
        return tuple(
            tuple(part.strip() for part in group.split(',') if part.strip())
            for group in self.groups
        )


def run_evaluate(request: EvaluateRequest, *, as_json: bool) -> None:
    """Evaluate each set of the recordings, print what came out, write the report."""
    if (recordings := list_recordings(request.recordings)) != list(request.recordings):
        groups = request.groups or ('session_id', 'mounting_id')
        request = replace(request, recordings=tuple(recordings), groups=groups)
    output = Output(as_json)
    file = None if request.report is None else report_path(request.report)
    with output.progress() as progress:
        progress.add_task('reading', total=None)
        sets = [
            replace(each, splits=request.train_test.splits(each.table))
            for each in _read_sets(request)
        ]
    results = analyse_with_progress(
        sets,
        output,
        folds=request.folds,
        repetitions=request.repetitions,
        random_state=request.seed,
        answers=request.answers,
    )
    for result in results:
        _print_result(result, output)
    if file is not None:
        write_report(file, results, request.recordings, _settings(request))
        output.say(f'{file}: the same with figures, learning curves, and the paper beside it')
    output.result({'sets': [result.to_dict() for result in results]})


def analyse_with_progress(
    sets: Sequence[RecordingSet], output: Output, **arguments: Any
) -> list[SetResult]:
    """Run all analyses of all sets under one progress bar, on all cores."""
    with output.progress() as progress:
        bar = progress.add_task('evaluating', total=None)
        return analyse(
            sets,
            progress=lambda done, total: progress.update(bar, completed=done, total=total),
            **arguments,
        )


def evaluate_with_progress(table: FeatureTable, output: Output, **arguments: Any) -> Evaluation:
    """Cross-validate with a progress bar, on all cores."""
    with output.progress() as progress:
        bar = progress.add_task('cross-validating', total=None)
        return evaluate(
            table,
            jobs=-1,
            progress=lambda done, total: progress.update(bar, completed=done, total=total),
            **arguments,
        )


def _print_result(result: SetResult, output: Output) -> None:
    for evaluation in result.evaluations:
        output.say(accuracy_table(evaluation, result.recordings.title, intervals=True))
        output.say(accuracy_caption(evaluation, intervals=True))
    output.say(f'  {describe_features(result.recordings.table.spec)}')
    lines = (
        *result.recordings.tell_preparation(most=10),
        *summarise_set(result),
        *result.not_done,
        *tell_warnings(result.evaluations),
    )
    for line in lines:
        output.say(f'  {line}')
    output.say()


def _settings(request: EvaluateRequest) -> dict[str, str]:
    names = (
        *('task', 'channel', 'where', 'train_where', 'test_where', 'crop', 'resample_hz'),
        *('over', 'speed_column', 'detrend', 'features'),
    )
    given = {name: getattr(request, name) for name in names}
    return {
        'folds': f'{request.folds}, dealt {request.repetitions} times',
        'seed of the folds': str(request.seed),
        **{name.replace('_', '-'): str(v) for name, v in given.items() if v is not None},
    }


def _read_sets(request: EvaluateRequest) -> list[RecordingSet]:
    archives = [path for path in request.recordings if path.suffix == '.npz']
    if archives and len(request.recordings) > 1:
        raise TactileError('evaluate one archive at a time, or bags only')
    if archives:
        return [_archive_set(archives[0], request)]
    for name in ('channel', 'where', 'crop', 'resample_hz', 'skip_bad', 'speed_column'):
        if getattr(request, name) not in (None, False):
            option = name.replace('_', '-')
            raise TactileError(f'--{option} is for archives; a bag says itself what a trial is')
    chosen = choose_features(request.over, request.detrend, request.features)
    tables = {
        key: select_features(request.train_test.keep(table), request.features)
        for key, table in read_tables(request.recordings, chosen).tables.items()
        if request.task in (None, key[0])
    }
    if not tables:
        raise TactileError(f'the bags hold no {request.task} trials')
    sets = bag_sets(tables, request.hold_out or None)
    if request.report is None or not any(map(_is_unlike_paper, tables.values())):
        return sets
    published = read_tables(request.recordings, PAPER).tables
    return [
        replace(
            each, published=_select_published(request.train_test.keep(published[key]), request)
        )
        if _is_unlike_paper(table)
        else each
        for each, (key, table) in zip(sets, tables.items(), strict=True)
    ]


def _is_unlike_paper(table: FeatureTable) -> bool:
    """Return whether these are other features of the very windows that the paper takes."""
    spec = table.spec
    if spec.feature_set != TextureSpectrum.name:
        return spec.feature_set == StiffnessRelaxation.name
    return any(spec.stated[name] != value for name, value in TextureSpectrum.unstated.items())


def _select_published(table: FeatureTable, request: EvaluateRequest) -> FeatureTable | None:
    """Return the wanted ones of the paper's features; None: it does not have them."""
    try:
        return select_features(table, request.features)
    except TactileError:
        return None


def _archive_set(path: Path, request: EvaluateRequest) -> RecordingSet:
    if request.task is None:
        raise TactileError(f'say what {path.name} is about: --task texture or --task stiffness')
    trials = load_archive(path, folds=request.folds, skip_bad=request.skip_bad)
    channel = parse_channel(request.channel or '0')
    title = [request.task, path.name]
    names: dict[Channel, str] = {None: 'mean of all channels', ALL: 'all channels'}
    title.append(names.get(channel, f'channel {channel}'))
    if request.where is not None:
        trials = trials.take(select_trials(trials.columns, request.where, 'where'))
        title.append(request.where)
    trials = request.train_test.keep(trials)
    if request.resample_hz is not None:
        trials = trials.resample(request.resample_hz)
        title.append(f'at {request.resample_hz:g} Hz')
    if request.crop is not None:
        start_s, stop_s = parse_span(request.crop)
        trials = trials.between(start_s, stop_s)
        title.append(f'{start_s:g} to {stop_s:g} s')
    config = FeatureConfig(**choose_features(request.over, request.detrend, request.features))
    speeds_m_s = None
    if request.over:
        title.append(f'over {request.over} mm')
    if request.over or config.feature_set(PHASE_GLIDE).needs_speed:
        speeds_m_s = _speeds_m_s(request, trials)
    table, trials = usable_table(
        request.task, trials, channel, config=config, speeds_m_s=speeds_m_s
    )
    published = None
    if request.report is not None and _is_unlike_paper(table):
        as_paper = table_from_trials(
            request.task, trials, channel, config=replace(config, **PAPER)
        )
        published = _select_published(as_paper, request)
    if request.features is not None:
        title.append(request.features)
    return RecordingSet(
        title=', '.join(title),
        contact='',
        simulated=bool(np.any(trials.columns.get('simulated', False))),
        table=select_features(table, request.features),
        hold_out=request.hold_out,
        unit='raw',
        examples=array_examples(
            table, trials.signal(None if channel == ALL else channel), trials.rate_hz
        ),
        published=published,
        skipped=trials.skipped,
        steps=trials.steps,
    )


def _speeds_m_s(request: EvaluateRequest, trials: LabelledTrials) -> NDArray[np.float64]:
    """Return the sliding speed of each trial, in the unit that its column's name says."""
    if request.task != PROTOCOL_TEXTURE:
        raise TactileError('features over the surface are for texture; a hold goes nowhere')
    name = request.speed_column
    if name is None or name not in trials.columns or trials.columns[name].dtype.kind not in 'fiu':
        raise TactileError(
            'name the column with the sliding speeds as numbers, as in --speed-column '
            f'speed_mm_s; there are: {", ".join(trials.columns) or "none"}'
        )
    for ending, unit_m_s in (('_mm_s', 1e-3), ('_m_s', 1.0)):
        if name.endswith(ending):
            return trials.columns[name].astype(np.float64) * unit_m_s
    raise TactileError(f'--speed-column: the name "{name}" must end in its unit, _mm_s or _m_s')


def parse_channel(text: str) -> Channel:
    """Return the number of a channel, ``all``, or None for ``mean``.

    Raises
    ------
    TactileError
        When it is none of these.
    """
    if text == 'mean':
        return None
    if text == ALL:
        return ALL
    if not text.isdecimal():
        raise TactileError(f'--channel is "{text}"; it must be a number from 0, "mean" or "all"')
    return int(text)


def parse_span(text: str) -> tuple[float, float]:
    """Return start and stop in seconds from ``START:STOP``.

    Raises
    ------
    TactileError
        When it is not of that form.
    """
    start, _, stop = text.partition(':')
    try:
        span = float(start), float(stop)
    except ValueError as error:
        raise TactileError(f'"{text}" is not START:STOP in seconds, as in 1:5') from error
    if not 0 <= span[0] < span[1] < float('inf'):
        raise TactileError(f'"{text}": START must be 0 or more and less than STOP')
    return span


def select_features(table: FeatureTable, names: str | None) -> FeatureTable:
    """Return the table with only the named features; the last part of a name is enough.

    Raises
    ------
    TactileError
        When there is no such feature, or several whose names end so.
    """
    if names is None or list_sets(names):
        return table
    short = [name.rpartition('__')[2] for name in table.spec.names]
    chosen = []
    for name in (part.strip() for part in names.split(',')):
        if name in table.spec.names:
            chosen.append(table.spec.names.index(name))
        elif name in short:
            fitting = [full for full in table.spec.names if full.rpartition('__')[2] == name]
            if len(fitting) > 1:
                raise TactileError(
                    f'"{name}" is the end of several names; write one of {", ".join(fitting)}'
                )
            chosen.append(short.index(name))
        else:
            raise TactileError(
                f'there is no feature "{name}"; there are {", ".join(short[:8])}'
                + (' ...' if len(short) > 8 else '')
            )
    spec = replace(
        table.spec,
        names=tuple(table.spec.names[i] for i in chosen),
        units=tuple(table.spec.units[i] for i in chosen),
    )
    return FeatureTable(table.values[:, chosen], table.labels, spec, table.columns)
