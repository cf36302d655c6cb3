# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile export`: raw trials as one long table for other programs, with a dataset card."""

from collections import Counter
from collections.abc import Sequence
import json
from pathlib import Path
from typing import Annotated, Any, TYPE_CHECKING

import typer

from tactile_lab import options
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_bags import Recording, Trial


def export(
    recordings: options.RecordingsArgument,
    file: Annotated[
        Path,
        typer.Option('--output', '-o', help='Table to write, ending in .parquet or .csv.'),
    ],
    force: Annotated[bool, typer.Option('--force', help='Replace the files.')] = False,
    column: options.ColumnOption = None,
    rate_hz: options.RateOption = None,
    unit: options.UnitOption = '',
    label: options.LabelOption = '',
    label_from: options.LabelFromOption = '',
    labels: options.LabelsOption = None,
    topic: options.TopicOption = '',
    field: options.FieldOption = '',
    separator: options.SeparatorOption = '',
    decimal: options.DecimalOption = '',
    header_rows: options.HeaderRowsOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Write the trials of recordings as one long table, with a dataset card beside it.

    A row a sample: trial, label, session_id, mounting_id, time_s, one column a channel, and what
    else is known of the trial. Units are in the metadata of Parquet columns. The card is Markdown
    with the fields that hubs read; its licence is to be filled in. `tactile import` reads the
    table back. Trials that do not count are left out.
    """
    given = locals()
    import pyarrow.csv
    import pyarrow.parquet

    from tactile_bags import Recording, SourceOptions
    from tactile_lab.output import Output, refuse_to_replace

    output = Output(as_json)
    if file.suffix not in ('.parquet', '.csv'):
        raise TactileError(f'--output is {file}; it must end in .parquet or .csv')
    card = file.with_suffix('.md')
    refuse_to_replace([file, card], force=force)
    statements = options.take(SourceOptions, given)
    with Recording.load(recordings, statements) as recording:
        table = recording.to_table()
        counting = [trial for trial in recording.trials if not trial.why_not]
        left_out = [f'{t.name}: {t.why_not}' for t in recording.trials if t.why_not]
        text = format_card(file, recording, counting, table)
        notes = [*recording.notes, *(f'left out: {sentence}' for sentence in left_out)]
    try:
        if file.suffix == '.parquet':
            pyarrow.parquet.write_table(table, file, compression='zstd')
        else:
            pyarrow.csv.write_csv(table, file)
        card.write_text(text, 'utf-8')
    except OSError as error:
        raise TactileError(f'cannot write {file}: {error.strerror}') from error
    for line in notes:
        output.say(line, plain=True)
    output.say(
        f'{file}: {len(counting)} trials, {table.num_rows} samples; columns: '
        f'{", ".join(table.column_names)}',
        plain=True,
    )
    output.say(f'{card}: its dataset card; state the licence before you publish both')
    output.result(
        {
            'path': str(file),
            'card': str(card),
            'trials': len(counting),
            'samples': table.num_rows,
            'columns': table.column_names,
            'notes': notes,
        }
    )


def format_card(file: Path, recording: 'Recording', trials: 'Sequence[Trial]', table: Any) -> str:
    """Return the dataset card of an exported table: Markdown with a head in YAML."""
    simulated = any(trial.simulated for trial in trials)
    labels = Counter(trial.label for trial in trials)
    sessions = sorted({trial.session_id for trial in trials} - {''})
    mountings = {trial.mounting_id for trial in trials} - {''}
    tasks = sorted({trial.task for trial in trials} - {''})
    contacts = sorted({trial.contact for trial in trials} - {''})
    size = next(
        name
        for name, end in (('n<1K', 1e3), ('1K<n<10K', 1e4), ('10K<n<100K', 1e5),
                          ('100K<n<1M', 1e6), ('1M<n<10M', 1e7), ('n>10M', float('inf')))
        if table.num_rows < end
    )  # fmt: skip
    title = f'{"SIMULATED " if simulated else ""}{file.stem}'
    head = {
        'pretty_name': title,
        'license': 'unknown',
        'task_categories': ['tabular-classification'],
        'tags': ['tactile', 'tendon', 'robotics', *tasks, *(['simulated'] if simulated else [])],
        'size_categories': [size],
        'configs': [{'config_name': 'default', 'data_files': file.name}],
    }
    # JSON values are YAML values, too.
    yaml = '\n'.join(f'{name}: {json.dumps(value)}' for name, value in head.items())
    rate = 'not known' if recording.rate_hz is None else f'{recording.rate_hz:g} Hz'
    lines = [
        f'---\n{yaml}\n---\n',
        f'# {title}\n',
        '**SIMULATED: these trials say nothing of a real finger.**\n' if simulated else '',
        'Tension of one tendon while a finger touches.\n',
        '| | |\n|---|---|',
        f'| task | {", ".join(tasks) or "not stated"} |',
        f'| trials | {len(trials)} |',
        f'| labels | {", ".join(f"{name} ({n})" for name, n in sorted(labels.items()))} |',
        f'| sessions | {len(sessions) or "not stated"} |',
        f'| mountings | {len(mountings) or "not stated"} |',
        f'| contacts | {", ".join(contacts) or "not stated"} |',
        f'| signal | {", ".join(trials[0].signal.channels)} [{recording.unit or "not known"}] |',
        f'| sample rate | {rate} |',
        f'| sensor | {"simulated load cell" if simulated else "to be filled in"} |',
        f'| rig | {"simulated" if simulated else "to be filled in"} |',
        f'| the recordings state | {_stated(recording) or "nothing"} |',
        '\n## Columns\n',
        '| column | type | unit |\n|---|---|---|',
        *(
            f'| `{each.name}` | {_format_type(each.type)} | {_unit_of(each)} |'
            for each in table.schema
        ),
        '\nA row is a sample, in the order of time within a trial. Hold whole sessions out when '
        'you test: trials of one session resemble each other.\n',
        '## Licence\n',
        'To be filled in, here and in the head (`license`). Rename this file to `README.md` to '
        'publish it beside the table on a hub.',
    ]
    return '\n'.join(line for line in lines if line) + '\n'


def _format_type(kind: Any) -> str:
    return str(getattr(kind, 'value_type', kind))  # a text stands once in a dictionary


def _unit_of(field: Any) -> str:
    return str((field.metadata or {}).get(b'unit', b'').decode())


def _stated(recording: 'Recording') -> str:
    """Return what the metadata of the bags state, without paths."""
    found = {
        f'{name}: {value}'
        for bag in recording.bags
        for name, value in bag.metadata.items()
        if isinstance(value, (str, int, float)) and '/' not in str(value) and value != ''
    }
    return '; '.join(sorted(found))
