# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile features`: write the features of recordings as a table."""

import json
from pathlib import Path
from typing import Annotated, Any, Optional, TYPE_CHECKING

import typer

from tactile_analysis.options import SourceOptions, TrialOptions
from tactile_lab import options
from tactile_lab.output import Output, refuse_suffix, refuse_to_replace, TABLES, write_table

if TYPE_CHECKING:
    from tactile_classifier.datasets.dataset import FeatureTable

KEY = b'tactile'
"""Key in the metadata of a Parquet file, whose value is the feature specification as JSON."""


def features(
    recordings: options.RecordingsArgument,
    file: Annotated[Path, typer.Option('--output', '-o', help='File to write: .parquet or .csv.')],
    task: options.TaskOption = None,
    features: Annotated[
        Optional[str],
        typer.Option(
            help='Compute this feature set instead of the recorded one, as in '
            '--features glide_waveform; or only these features, separated by commas.'
        ),
    ] = None,
    group: Annotated[
        Optional[str],
        typer.Option(
            help='Columns, separated by commas, whose values are written to the column "group". '
            'Default: mounting_id, if available.'
        ),
    ] = None,
    over: options.OverOption = None,
    detrend: options.DetrendOption = None,
    archives: TrialOptions = options.TRIALS,
    force: Annotated[bool, typer.Option('--force', help='Replace the file.')] = False,
    statements: SourceOptions = options.SOURCES,
    as_json: options.JsonOption = False,
) -> None:
    """Write the features of recordings as a table, for notebooks and other programs.

    The table has one row per trial, with the columns source, trial, label, session, group,
    simulated, and one column per feature. Units are in the metadata of Parquet columns, or in the
    names of CSV columns. If there are several tasks or contacts, a file is written for each
    combination; task and contact are appended to its name.
    """
    import numpy as np

    from tactile_analysis.datasets.feature_options import FeatureOptions, select_features
    from tactile_analysis.datasets.feature_tables import compute_tables, open_trials

    output = Output(as_json)
    refuse_suffix('--output', file, TABLES)
    feature_options = FeatureOptions(
        task=task, over=over, detrend=detrend, features=features, **vars(archives)
    )
    with (
        output.progress('computing features'),
        open_trials(recordings, feature_options, statements) as source,
    ):
        tables, left_out = compute_tables(source, feature_options)
        steps = [] if source.is_own else source.notes
    written = []
    for key, table in tables.items():
        kind = '_'.join(filter(None, key))
        path = file
        if len(tables) > 1:
            path = file.with_name(f'{file.stem}_{kind}{file.suffix}')
        written.append((path, kind, select_features(table, features)))
    refuse_to_replace([path for path, _, _ in written], force=force)
    notes = [*steps, *(f'excluded: {sentence}' for sentence in left_out)]
    output.say(*notes)
    for path, kind, table in written:
        columns = _columns(table, group, str(source.paths[0]))
        write_table(_to_arrow(columns, table, is_csv=path.suffix.lower() == '.csv'), path)
        output.say(
            f'{path}: {kind}, {len(table)} trials of {len(np.unique(table.labels))} labels, '
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


def _columns(table: 'FeatureTable', group: Optional[str], source: str) -> dict[str, Any]:
    """Return the columns before the features: source, trial, label, session, group, simulated."""
    import numpy as np

    known = table.columns
    blank = np.full(len(table), '')
    session = known.get('session_id', blank)
    if group is None:
        groups = known.get('mounting_id', blank)
    else:
        parts = [table.column(name).astype(str) for name in options.split(group)]
        groups = np.array(['/'.join(row) for row in zip(*parts, strict=True)])
    return {
        'source': known.get('bag', known.get('source', np.full(len(table), source))),
        'trial': known['trial_id'],
        'label': table.labels,
        'session': session.astype(str),
        'group': groups.astype(str),
        'simulated': np.asarray(known.get('simulated', np.zeros(len(table)))).astype(bool),
    }


def _to_arrow(columns: dict[str, Any], table: 'FeatureTable', *, is_csv: bool) -> Any:
    """Return an Arrow table of all columns.

    Units of features are in the metadata, and if ``is_csv`` is True also in the column names.
    """
    import pyarrow

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
    return pyarrow.Table.from_arrays(data, schema=schema)
