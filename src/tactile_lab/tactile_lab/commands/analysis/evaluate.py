# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile evaluate`: cross-validated accuracy on archives and bags, and the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from tactile_classifier.datasets.dataset import ALL, FeatureTable
from tactile_classifier.names import describe_features
from tactile_classifier.training.feature_choice import Candidate, FeatureChoice
from tactile_features.feature_sets.stiffness import (
    StiffnessRegression,
    StiffnessRelaxation,
)
from tactile_features.feature_sets.texture_spectrum import TextureSpectrum
from tactile_lab.commands.analysis.features import AUTO, choose_automatically, keep_task, Reader
from tactile_lab.commands.analysis.requests import EvaluateRequest
from tactile_lab.commands.output import Output
from tactile_lab.datasets.bag_tables import BagTables, Key, read_tables
from tactile_lab.datasets.feature_options import choose_features, select_features
from tactile_lab.datasets.prepared import prepare_trials, PreparedTrials
from tactile_lab.datasets.sources.load import split_sources
from tactile_lab.datasets.tables import accuracy_caption, accuracy_table, tell_warnings
from tactile_lab.experiment.folder import list_recordings
from tactile_lab.report.analysis import analyse, SetResult
from tactile_lab.report.recordings import array_examples, bag_sets, RecordingSet
from tactile_lab.report.summary import answer_rows, format_accuracy
from tactile_ros.errors import TactileError

PAPER: Mapping[str, Any] = MappingProxyType(
    {
        'spectrum_detrend': 'mean',
        'spectrum_window': 'none',
        'stiffness_features': StiffnessRegression.name,
    }
)
"""The paper's features of its own windows, by the fields of `FeatureConfig`."""


def run_evaluate(request: EvaluateRequest, *, as_json: bool) -> None:
    """Evaluate each set of the recordings, print what came out, write the report."""
    if (recordings := list_recordings(request.recordings)) != list(request.recordings):
        request = replace(request, recordings=recordings, is_experiment=True)
    output = Output(as_json)
    file = None
    if request.report is not None:
        from tactile_lab.report.build import report_path, write_report  # matplotlib

        file = report_path(request.report)
    with output.progress('reading'):
        sets = [
            replace(each, splits=request.train_test.splits(each.table))
            for each in _read_sets(request, output)
        ]
    with output.progress('evaluating') as show:
        results = analyse(
            sets,
            progress=show,
            folds=request.folds,
            repetitions=request.repetitions,
            random_state=request.seed,
            answers=request.answers,
            details=as_json or file is not None,  # the terminal has no place for them
        )
    for result in results:
        _print_result(result, output)
    if file is not None:
        write_report(file, results, request.recordings, _settings(request))
        output.say(f'{file}: the same with figures, and the paper beside it')
    output.result({'sets': [result.to_dict() for result in results]})


def _print_result(result: SetResult, output: Output) -> None:
    for evaluation in result.evaluations:
        output.say(accuracy_table(evaluation, result.recordings.title, intervals=True))
        output.say(accuracy_caption(evaluation, intervals=True))
    output.say(f'  {describe_features(result.recordings.table.spec)}')
    lines = (
        *result.recordings.tell_preparation(most=10),
        format_accuracy(result),
        *(': '.join(row) for row in (answer_rows(result.answers) if result.answers else ())),
        *result.not_done,
        *tell_warnings(result.evaluations),
    )
    for line in lines:
        output.say(f'  {line}', plain=True)
    output.say()


def _describe_folds(request: EvaluateRequest) -> str:
    if request.repetitions is None:
        return str(request.folds)
    return f'{request.folds}, repeated {request.repetitions} times'


def _settings(request: EvaluateRequest) -> dict[str, str]:
    names = (
        *('task', 'channel', 'where', 'train_where', 'test_where', 'crop', 'resample_hz'),
        *('over', 'speed_column', 'detrend', 'features'),
    )
    given = {name: getattr(request, name) for name in names}
    return {
        'folds': _describe_folds(request),
        'seed of the folds': str(request.seed),
        **{name.replace('_', '-'): str(v) for name, v in given.items() if v is not None},
    }


def _read_sets(request: EvaluateRequest, output: Output) -> list[RecordingSet]:
    own, leaves = split_sources(request.recordings, request.sources)
    if leaves:
        if request.features != AUTO:
            prepared = prepare_trials(leaves, request, folds=request.folds)
            return [_prepared_set(prepared, request)]
        named = replace(request, features=None)
        prepared = prepare_trials(leaves, named, folds=request.folds)
        key = (prepared.task, '')
        table, candidate, choice = _choose(
            lambda fields: BagTables({key: prepared.compute_table(fields)}, ()),
            {},
            request,
            output,
        )[key]
        title = f'{prepared.title}, {AUTO}: {table.spec.feature_set}'
        found = _prepared_set(replace(prepared, title=title, table=table), named)
        return [replace(found, choice=(candidate, choice))]
    request.check_for_bags()
    automatic = request.features == AUTO
    if automatic:
        request = replace(request, features=None)
    chosen = choose_features(request.over, request.detrend, request.features)
    read = partial(read_tables, own)
    choices = _choose(read, chosen, request, output) if automatic else {}
    tables = {key: table for key, (table, *_) in choices.items()} or read(chosen).tables
    tables = {
        key: select_features(request.train_test.keep(table), request.features)
        for key, table in keep_task(tables, request.task).items()
    }
    sets = bag_sets(
        tables, request.hold_out or None, also=('mounting_id',) if request.is_experiment else ()
    )
    if choices:
        chosen_for = [choices[key][1:] for key in tables]
        sets = [replace(e, choice=choice) for e, choice in zip(sets, chosen_for, strict=True)]
    if request.report is None or not any(map(_is_unlike_paper, tables.values())):
        return sets
    published = read_tables(own, PAPER).tables
    return [
        replace(
            each,
            published=_select_published(request.train_test.keep(published[key[:2]]), request),
        )
        if _is_unlike_paper(table)
        else each
        for each, (key, table) in zip(sets, tables.items(), strict=True)
    ]


def _choose(
    read: Reader, chosen: Mapping[str, Any], request: EvaluateRequest, output: Output
) -> dict[Key, tuple[FeatureTable, Candidate, FeatureChoice]]:
    """Return the tables with the set of features that folds choose, and say why."""
    columns = next(iter(request.hold_out), ('session_id',))
    return choose_automatically(
        read,
        chosen,
        request.folds,
        request.seed,
        output,
        columns=columns,
        train_test=request.train_test,
    )


def _is_unlike_paper(table: FeatureTable) -> bool:
    """Return whether these are other features of the very windows that the paper takes."""
    spec = table.spec
    if spec.feature_set != TextureSpectrum.name:
        return spec.feature_set == StiffnessRelaxation.name
    return any(spec.parameters.get(name) != PAPER[name] for name in TextureSpectrum.options)


def _select_published(table: FeatureTable, request: EvaluateRequest) -> FeatureTable | None:
    """Return the wanted ones of the paper's features; None: it does not have them."""
    try:
        return select_features(table, request.features)
    except TactileError:
        return None


def _prepared_set(prepared: PreparedTrials, request: EvaluateRequest) -> RecordingSet:
    trials, channel = prepared.trials, prepared.channel
    published = None
    if request.report is not None and _is_unlike_paper(prepared.table):
        published = _select_published(prepared.compute_table(PAPER), request)
    named = request.features
    return RecordingSet(
        title=prepared.title if named is None else f'{prepared.title}, {named}',
        contact='',
        simulated=bool(np.any(trials.columns.get('simulated', False))),
        table=select_features(prepared.table, request.features),
        hold_out=request.hold_out,
        unit='raw',
        examples=array_examples(
            prepared.table, trials.signal(None if channel == ALL else channel), trials.rate_hz
        ),
        published=published,
        skipped=trials.skipped,
        steps=trials.steps,
    )
