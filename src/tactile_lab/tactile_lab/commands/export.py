# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile export`: write raw trials as one long table, with a dataset card."""

from collections import Counter
from collections.abc import Sequence
import json
from pathlib import Path
from typing import Annotated, Any, TYPE_CHECKING

import typer

from tactile_analysis.options import SourceOptions
from tactile_lab import options
from tactile_lab.output import (
    Output,
    refuse_suffix,
    refuse_to_replace,
    TABLES,
    write_table,
)
from tactile_ros.errors import named_errors

if TYPE_CHECKING:
    from tactile_analysis import TrialSet
    from tactile_bags import Trial

_SIZES = {
    'n<1K': 1e3,
    '1K<n<10K': 1e4,
    '10K<n<100K': 1e5,
    '100K<n<1M': 1e6,
    '1M<n<10M': 1e7,
    'n>10M': float('inf'),
}


def export(
    recordings: options.RecordingsArgument,
    file: Annotated[
        Path,
        typer.Option('--output', '-o', help='Table to write, ending in .parquet or .csv.'),
    ],
    force: Annotated[bool, typer.Option('--force', help='Replace the files.')] = False,
    statements: SourceOptions = options.SOURCES,
    as_json: options.JsonOption = False,
) -> None:
    """Write the trials of recordings as one long table, with a dataset card beside it.

    The table has one row per sample, with the columns trial, label, session_id, mounting_id,
    time_s, one column per channel, and other known properties of the trial. In Parquet, units are
    in the metadata of the columns. The card is a Markdown file with the header that dataset hubs
    read; add the licence yourself. `tactile import` reads the table. Excluded trials are not
    written.
    """
    from tactile_analysis import TrialSet

    output = Output(as_json)
    refuse_suffix('--output', file, TABLES)
    card = file.with_suffix('.md')
    refuse_to_replace([file, card], force=force)
    with TrialSet.load(recordings, statements) as recording:
        table = recording.to_table()
        counting = recording.included
        left_out = [  # the reason of a faulty trial begins with its name
            str(t.why_not) if t.is_faulty else f'{t.name}: {t.why_not}'
            for t in recording.trials
            if t.why_not
        ]
        text = format_card(file, recording, counting, table)
        notes = [*recording.notes, *(f'excluded: {sentence}' for sentence in left_out)]
    write_table(table, file)
    with named_errors('write', card):
        card.write_text(text, 'utf-8')
    output.say(*notes)
    output.say(
        f'{file}: {len(counting)} trials, {table.num_rows} samples; columns: '
        f'{", ".join(table.column_names)}',
    )
    output.say(f'{card}: its dataset card; add the licence before you publish both')
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


def format_card(file: Path, recording: 'TrialSet', trials: 'Sequence[Trial]', table: Any) -> str:
    """Return the dataset card of an exported table: Markdown with a YAML header."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    def stated(name: str) -> list[str]:
        return sorted({getattr(trial, name) for trial in trials} - {''})

    simulated, tasks = any(trial.simulated for trial in trials), stated('task')
    title = f'{"SIMULATED " if simulated else ""}{file.stem}'
    head = {
        'pretty_name': title,
        'license': 'unknown',
        'task_categories': ['tabular-classification'],
        'tags': ['tactile', 'tendon', 'robotics', *tasks, *(['simulated'] if simulated else [])],
        'size_categories': [next(name for name, end in _SIZES.items() if table.num_rows < end)],
        'configs': [{'config_name': 'default', 'data_files': file.name}],
    }
    environment = Environment(
        loader=PackageLoader('tactile_analysis.report'),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    return environment.get_template('dataset_card.md').render(
        # JSON values are valid YAML.
        head='\n'.join(f'{name}: {json.dumps(value)}' for name, value in head.items()),
        title=title,
        simulated=simulated,
        tasks=tasks,
        trial_count=len(trials),
        labels=sorted(Counter(trial.label for trial in trials).items()),
        sessions=stated('session_id'),
        mountings=stated('mounting_id'),
        contacts=stated('contact'),
        channels=trials[0].signal.channels,
        recording=recording,
        facts=_stated(recording),
        columns=[
            # A dictionary column has the type of its values.
            (
                each.name,
                getattr(each.type, 'value_type', each.type),
                (each.metadata or {}).get(b'unit', b'').decode(),
            )
            for each in table.schema
        ],
    )


def _stated(recording: 'TrialSet') -> str:
    """Return the metadata of the bags as text, except entries that contain a path."""
    found = {
        f'{name}: {value}'
        for bag in recording.bags
        for name, value in bag.metadata.items()
        if isinstance(value, (str, int, float)) and '/' not in str(value) and value != ''
    }
    return '; '.join(sorted(found))
