# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile import`: convert recordings of other programs to one archive of labelled trials."""

from pathlib import Path
from typing import Annotated, Optional, TYPE_CHECKING

import typer

from tactile_analysis.options import SourceOptions
from tactile_lab import options
from tactile_lab.output import Output, PICTURES, refuse_suffix, refuse_to_replace
from tactile_ros.errors import named_errors, TactileError

if TYPE_CHECKING:
    from tactile_analysis import TrialSet
    from tactile_classifier.datasets.archive import LabelledTrials

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
            help='File for a figure of three trials, with their unit and the window from which '
            'features are computed: .png, .svg or .pdf.',
        ),
    ] = None,
    skip_bad: options.SkipBadOption = False,
    force: Annotated[bool, typer.Option('--force', help='Replace the files.')] = False,
    statements: SourceOptions = options.SOURCES,
    as_json: options.JsonOption = False,
) -> None:
    """Convert recordings of other programs to one archive.

    The output lists missing information, the columns that were used, and a command to evaluate the
    archive. Nothing is guessed: if information is missing, the message names the option to add it.
    """
    import numpy as np

    from tactile_analysis import TrialSet
    from tactile_classifier.datasets.archive import save_archive

    output = Output(as_json)
    refuse_suffix('--output', archive, ['.npz'])
    if plot is not None:
        refuse_suffix('--plot', plot, PICTURES)
    refuse_to_replace([archive, *([plot] if plot else [])], force=force)
    with TrialSet.load(recordings, statements) as recording:
        if recording.is_own:
            raise TactileError(
                f'{recording.paths[0]} is a bag with trial events: train, evaluate and features '
                'read it directly; `tactile export` writes it for other programs'
            )
        trials = recording.to_arrays(skip_bad=skip_bad)
        if plot is not None:
            _draw(plot, recording, trials)
    skipped = [{'row': each.row, 'reason': each.reason} for each in trials.skipped]
    left_out = (f'left out: row {each.row}: {each.reason}' for each in trials.skipped)
    output.say(*trials.steps, *left_out)
    names, counts = np.unique(trials.label, return_counts=True)
    found = {str(name): int(count) for name, count in zip(names, counts, strict=True)}
    with named_errors('write', archive):
        save_archive(archive, trials)
    shortest, longest = int(trials.lengths.min()), int(trials.lengths.max())
    samples = f'{shortest}' if shortest == longest else f'{shortest} to {longest}'
    channels = len(trials.channels)
    shown = ', '.join(f'{name} {count}' for name, count in list(found.items())[:SHOWN_LABELS])
    output.say(
        f'{archive}: {len(trials)} trials of {len(found)} labels ({shown}), '
        f'{channels} channel{"s" if channels > 1 else ""}'
        f'{f" in {trials.unit}" if trials.unit else ""}, {samples} samples at '
        f'{trials.rate_hz:g} Hz; columns: {", ".join(trials.columns) or "none"}',
    )
    if plot is not None:
        output.say(f'{plot}: {min(DRAWN, len(trials))} trials')
    if channels > 1:
        output.say(
            f'features use channel {trials.channels[0]}; not used: '
            f'{", ".join(trials.channels[1:])}; --channel NAME, mean or all selects others'
        )
    command, *remarks = next_command(archive, trials)
    output.say(*remarks, f'next: {command}')
    output.result(
        {
            'path': str(archive),
            'trials': len(trials),
            'labels': found,
            'channels': channels,
            'channel_names': list(trials.channels),
            'samples': [shortest, longest],
            'rate_hz': trials.rate_hz,
            'unit': trials.unit or None,
            'columns': list(trials.columns),
            'notes': list(trials.steps),
            'skipped': skipped,
            'next': command,
            'remarks': remarks,
        }
    )


def next_command(archive: Path, trials: 'LabelledTrials') -> list[str]:
    """Return the command that evaluates an archive with groups held out, then remarks on it."""
    from tactile_analysis.sources.files import find_group_word, GROUP_WORDS

    command = f'tactile evaluate {archive} --task texture (or stiffness)'
    words = {name: find_group_word(name) for name in trials.columns}
    named = sorted(filter(words.get, words), key=lambda name: GROUP_WORDS.index(words[name]))
    groups = [name for name in named if _can_hold_out(trials, name)]
    remarks = [
        f'column {name} cannot be held out: all trials of some label have the same {name}'
        for name in named
        if name not in groups and len(set(trials.columns[name].tolist())) > 1
    ]
    if groups[1:]:
        options = ', '.join(f'--group {name}' for name in groups[1:])
        remarks.append(f'in addition to --group {groups[0]}, or instead of it: {options}')
    if groups:
        return [f'{command} --group {groups[0]}', *remarks]
    text = 'no column is named like sessions, days, subjects or specimens'
    others = [name for name in trials.columns if name not in named and _can_hold_out(trials, name)]
    if others:
        names = ' or '.join(others[:SHOWN_GROUPS])
        return [command, *remarks, f'{text}; does one divide the trials: --group {names}?']
    return [command, *remarks, f'{text}: random folds only, which are optimistic']


def _can_hold_out(trials: 'LabelledTrials', name: str) -> bool:
    """Return True if each label is in two or more groups, of two or more trials on average."""
    import numpy as np

    column = trials.columns[name]
    groups = len(np.unique(column))
    return 2 * groups <= len(trials) and all(
        len(np.unique(column[trials.label == label])) > 1 for label in np.unique(trials.label)
    )


def _draw(plot: Path, recording: 'TrialSet', trials: 'LabelledTrials') -> None:
    from tactile_analysis.plots import plot_signals

    usable = [trial for trial in recording.trials if not trial.why_not]
    first = list({trial.label: trial for trial in reversed(usable)}.values())[::-1]
    chosen = [*first, *(trial for trial in usable if trial not in first)][:DRAWN]
    titled = [(f'{trial.label}, trial {trial.name}', trial.signal) for trial in chosen]
    with named_errors('write', plot):
        plot_signals(plot, titled, float(trials.lengths.min()) / trials.rate_hz)
