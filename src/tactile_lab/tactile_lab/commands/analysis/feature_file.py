# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile features`: the features of recordings as a table for other programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_lab.commands.analysis.features import keep_task
from tactile_lab.commands.analysis.requests import FeaturesRequest
from tactile_lab.commands.output import Output, refuse_to_replace
from tactile_lab.datasets.bag_tables import Key, read_tables
from tactile_lab.datasets.feature_options import choose_features, select_features
from tactile_lab.datasets.prepared import prepare_trials
from tactile_lab.datasets.sources.load import split_sources
from tactile_lab.datasets.sources.table_files import load_pyarrow
from tactile_lab.experiment.folder import list_recordings
from tactile_ros.errors import TactileError

KEY = b'tactile'
"""Of the schema's metadata that holds the specification of the features, as JSON."""


def run_features(request: FeaturesRequest, *, as_json: bool) -> None:
    """Compute features and write one file for each task and contact of the recordings.

    Raises
    ------
    TactileError, DatasetError
        When options and recordings do not fit, or a file would be replaced.
    """
    output = Output(as_json)
    if request.file.suffix not in ('.parquet', '.csv'):
        raise TactileError(f'--output is {request.file}; it must end in .parquet or .csv')
    load_pyarrow()  # before the work
    with output.progress('computing features'):
        tables, notes = _read(request)
    several = len(tables) > 1
    written = []
    for key, table in tables.items():
        kind = '_'.join(filter(None, key))
        path = request.file
        if several:
            path = path.with_name(f'{path.stem}_{kind}{path.suffix}')
        written.append((path, kind, table))
    refuse_to_replace([path for path, _, _ in written], force=request.force)
    for line in notes:
        output.say(line, plain=True)
    for path, kind, table in written:
        columns = _columns(table, request.group)
        _write(path, columns, table)
        labels = len(np.unique(table.labels))
        output.say(
            f'{path}: {kind}, {len(table)} trials of {labels} labels, '
            f'{len(table.spec.names)} features of {table.spec.feature_set}'
        )
    output.result(
        {
            'notes': notes,
            'files': [
                {
                    'path': str(path),
                    'kind': kind,
                    'trials': len(table),
                    'labels': np.unique(table.labels).tolist(),
                    'feature_set': table.spec.feature_set,
                    'features': dict(zip(table.spec.names, table.spec.units, strict=True)),
                    'sha256_of_table': table.compute_sha256(),
                }
                for path, kind, table in written
            ],
        }
    )


def _read(request: FeaturesRequest) -> tuple[dict[Key, FeatureTable], list[str]]:
    own, leaves = split_sources(list_recordings(request.recordings), request.sources)
    if leaves:
        prepared = prepare_trials(leaves, request, folds=0)
        trials = prepared.trials
        skipped = [f'left out: row {each.row}: {each.reason}' for each in trials.skipped]
        table = prepared.table
        if 'source' not in table.columns:
            source = np.full(len(table), str(leaves[0].path))
            table = FeatureTable(
                table.values, table.labels, table.spec, {**table.columns, 'source': source}
            )
        tables: dict[Key, FeatureTable] = {(prepared.task, ''): table}
        notes = [*trials.steps, *skipped]
    else:
        request.check_for_bags()
        chosen = choose_features(request.over, request.detrend, request.features)
        found = read_tables(own, chosen)
        tables = keep_task(found.tables, request.task)
        notes = [f'left out: {sentence}' for sentence in found.left_out]
    return {key: select_features(table, request.features) for key, table in tables.items()}, notes


def _columns(table: FeatureTable, group: str | None) -> dict[str, NDArray[Any]]:
    """Return what is known of each trial: source, trial, label, session, group."""
    known = table.columns
    blank = np.full(len(table), '')
    session = known.get('session_id', blank)
    if group is None:
        groups = known.get('mounting_id', blank)
    else:
        parts = [table.column(name.strip()).astype(str) for name in group.split(',')]
        groups = np.array(['/'.join(row) for row in zip(*parts, strict=True)])
    return {
        'source': known['bag'] if 'bag' in known else known['source'],
        'trial': known['trial_id'],
        'label': table.labels,
        'session': session.astype(str),
        'group': groups.astype(str),
        'simulated': np.asarray(known.get('simulated', np.zeros(len(table)))).astype(bool),
    }


def _write(path: Path, columns: dict[str, NDArray[Any]], table: FeatureTable) -> None:
    """Write a file; units stand in the metadata of a Parquet file and in the names of a CSV."""
    pyarrow = load_pyarrow()
    is_csv = path.suffix == '.csv'
    fields = [
        pyarrow.field(name, pyarrow.bool_() if column.dtype.kind == 'b' else pyarrow.string())
        for name, column in columns.items()
    ]
    for name, unit in zip(table.spec.names, table.spec.units, strict=True):
        stated = f'{name} [{unit}]' if is_csv else name
        fields.append(pyarrow.field(stated, pyarrow.float64(), metadata={'unit': unit}))
    arrays = [column.tolist() for column in columns.values()]
    data = [
        *(pyarrow.array(a, type=f.type) for a, f in zip(arrays, fields, strict=False)),
        *(pyarrow.array(column) for column in table.values.T),
    ]
    schema = pyarrow.schema(fields, metadata={KEY: json.dumps(table.spec.to_dict())})
    found = pyarrow.Table.from_arrays(data, schema=schema)
    try:
        if is_csv:
            pyarrow.csv.write_csv(found, path)
        else:
            pyarrow.parquet.write_table(found, path)
    except OSError as error:
        raise TactileError(f'cannot write {path}: {error}') from error
