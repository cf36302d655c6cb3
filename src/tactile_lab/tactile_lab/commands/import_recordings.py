# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile import`: convert recordings of other programs to one archive of labelled trials."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Optional, TYPE_CHECKING

import typer

from tactile_analysis.options import SourceOptions
from tactile_lab import options
from tactile_lab.output import Output, PICTURES, refuse_suffix, refuse_to_replace
from tactile_ros.errors import named_errors, TactileError

if TYPE_CHECKING:
    from tactile_analysis import TrialSet

SHOWN_LABELS = 12

SHOWN_GROUPS = 6
"""Largest number of columns that are proposed as groups."""

DRAWN = 3
"""Number of trials in the figure."""


def import_recordings(
    recordings: options.RecordingsArgument,
    archive: Annotated[
        Path, typer.Option('--output', '-o', help='Archive to write, ending in .npz.')
    ],
    plot: Annotated[
        Optional[Path],
        typer.Option(
            metavar='FILE',
            help='Draw three trials to this file, with their unit and the window from which '
            'features are computed: .png, .svg or .pdf.',
        ),
    ] = None,
    skip_bad: options.SkipBadOption = False,
    force: Annotated[bool, typer.Option('--force', help='Replace the files.')] = False,
    statements: SourceOptions = options.SOURCES,
    as_json: options.JsonOption = False,
) -> None:
    """Convert recordings of other programs to one archive.

    Without options, the command uses columns and arrays with known names (such as force, time and
    label), units in these names, and names of folders as labels. It prints what it has used, and a
    command that evaluates the archive. If something is missing or can be read in several ways, the
    error names the option that states it.
    """
    from tactile_analysis import TrialSet
    from tactile_analysis.sources.signals import join_columns

    output = Output(as_json)
    refuse_suffix('--output', archive, ['.npz'])
    if plot is not None:
        refuse_suffix('--plot', plot, PICTURES)
    refuse_to_replace([archive, *([plot] if plot else [])], force=force)
    with TrialSet.load(recordings, statements) as recording:
        if recording.is_own:
            raise TactileError(
                f'{recording.paths[0]} is a bag with trial events and needs no import: `tactile '
                'train`, `evaluate` and `features` read it directly, and `tactile export` '
                'converts it for other programs'
            )
        trials = recording.even(skip_bad=skip_bad)
        if plot is not None:
            _draw(plot, trials)
    with named_errors('write', archive):
        trials.save(archive)
    output.say(*trials.notes, *(f'skipped: {sentence}' for sentence in trials.skipped))
    included, columns = trials.included, join_columns(trials.name_trials())
    labels = columns.pop('label').tolist()
    found = dict(sorted(Counter(labels).items()))
    names, rate_hz, unit = included[0].signal.channels, trials.rate_hz, trials.unit
    counts = [trial.signal.values.shape[1] for trial in included]
    shortest, longest = min(counts), max(counts)
    samples = f'{shortest}' if shortest == longest else f'{shortest} to {longest}'
    channels = len(names)
    shown = ', '.join(f'{name} {count}' for name, count in list(found.items())[:SHOWN_LABELS])
    output.say(
        f'{archive}: {len(included)} trials of {len(found)} labels ({shown}), '
        f'{channels} channel{"s" if channels > 1 else ""}'
        f'{f" in {unit}" if unit else ""}, {samples} samples at '
        f'{rate_hz:g} Hz; columns: {", ".join(columns) or "none"}',
    )
    if plot is not None:
        output.say(f'{plot}: {min(DRAWN, len(included))} trials')
    if channels > 1:
        output.say(
            f'features are computed from channel {names[0]}; other channels '
            f'({", ".join(names[1:])}) are selected with --channel NAME, mean or all'
        )
    command, *remarks = next_command(archive, columns, labels)
    output.say(*remarks, f'next: {command}')
    output.result(
        {
            'path': str(archive),
            'trials': len(included),
            'labels': found,
            'channels': channels,
            'channel_names': list(names),
            'samples': [shortest, longest],
            'rate_hz': rate_hz,
            'unit': unit or None,
            'columns': list(columns),
            'notes': trials.notes,
            'skipped': trials.skipped,
            'next': command,
            'remarks': remarks,
        }
    )


def next_command(archive: Path, columns: Mapping[str, Any], labels: Sequence[str]) -> list[str]:
    """Return a command that evaluates the archive, followed by remarks about the command.

    The command holds out groups of trials if a column has the name of a group, such as session.
    """
    from tactile_analysis.sources.files import find_group_word, GROUP_WORDS

    command = f'tactile evaluate {archive} --task texture (or stiffness)'
    words = {name: find_group_word(name) for name in columns}
    named = sorted(filter(words.get, words), key=lambda name: GROUP_WORDS.index(words[name]))
    groups = [name for name in named if _can_hold_out(columns[name], labels)]
    remarks = [
        f'groups of column {name} cannot be held out, because some label has only one {name}'
        for name in named
        if name not in groups and len(set(columns[name].tolist())) > 1
    ]
    if groups[1:]:
        options = ', '.join(f'--group {name}' for name in groups[1:])
        remarks.append(f'other groups can be held out in addition or instead: {options}')
    if groups:
        return [f'{command} --group {groups[0]}', *remarks]
    text = 'no column has a name such as session, day, subject or specimen'
    others = [
        name for name in columns if name not in named and _can_hold_out(columns[name], labels)
    ]
    if others:
        names = ' or '.join(others[:SHOWN_GROUPS])
        return [
            command,
            *remarks,
            f'{text}; if a column contains groups of trials, hold them out: --group {names}',
        ]
    return [
        command,
        *remarks,
        f'{text}, so only random folds are possible, and their accuracy is optimistic',
    ]


def _can_hold_out(column: Any, labels: Sequence[str]) -> bool:
    """Return True if whole groups of trials with equal values in a column can be held out.

    This requires that each label occurs in at least two groups, and that groups have at least two
    trials on average.
    """
    groups: dict[str, set[Any]] = {}
    for label, group in zip(labels, column.tolist(), strict=True):
        groups.setdefault(label, set()).add(group)
    return 2 * len(set(column.tolist())) <= len(labels) and all(
        len(each) > 1 for each in groups.values()
    )


def _draw(plot: Path, trials: 'TrialSet') -> None:
    from tactile_analysis.plots import plot_signals

    usable = trials.included
    first = list({trial.label: trial for trial in reversed(usable)}.values())[::-1]
    chosen = [*first, *(trial for trial in usable if trial not in first)][:DRAWN]
    titled = [(f'{trial.label}, trial {trial.name}', trial.signal) for trial in chosen]
    shortest_s = min(t.signal.values.shape[1] / t.signal.rate_hz for t in usable)
    with named_errors('write', plot):
        plot_signals(plot, titled, shortest_s)
