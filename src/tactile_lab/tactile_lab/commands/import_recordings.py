# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile import`: recordings of others as one labelled-trials archive."""

from pathlib import Path
from typing import Annotated, Optional, TYPE_CHECKING

import typer

from tactile_lab import options
from tactile_lab.output import named_errors, Output, PICTURES, refuse_suffix, refuse_to_replace
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_bags import Recording
    from tactile_classifier.datasets.archive import LabelledTrials

SHOWN_LABELS = 12

DRAWN = 3
"""Trials in the picture."""

GROUPS = ('session_id', 'day', 'subject', 'specimen', 'mounting_id', 'block', 'folder')
"""Columns that a test should hold out, the most likely one first."""


def import_recordings(
    recordings: options.RecordingsArgument,
    archive: Annotated[
        Path, typer.Option('--output', '-o', help='Archive to write, ending in .npz.')
    ],
    plot: Annotated[
        Optional[Path],
        typer.Option(
            metavar='FILE',
            help='Draw three trials with their unit and the window that features take into this '
            'file: .png, .svg or .pdf.',
        ),
    ] = None,
    skip_bad: options.SkipBadOption = False,
    force: Annotated[bool, typer.Option('--force', help='Replace the files.')] = False,
    statements: options.Statements = options.STATEMENTS,
    as_json: options.JsonOption = False,
) -> None:
    """Make one archive of recordings that other programs made.

    The first line says what could not be known, the next ones what was taken for what, the last
    one how to evaluate the archive. Nothing is guessed: where a recording does not say something,
    the command names the option that does.
    """
    import numpy as np

    from tactile_bags import Recording, SourceOptions
    from tactile_classifier.datasets.archive import save_archive

    output = Output(as_json)
    refuse_suffix('--output', archive, ['.npz'])
    if plot is not None:
        refuse_suffix('--plot', plot, PICTURES)
    refuse_to_replace([archive, *([plot] if plot else [])], force=force)
    with Recording.load(recordings, SourceOptions(**vars(statements))) as recording:
        if recording.is_own:
            raise TactileError(
                f'{recording.paths[0]} is a bag with trial events: train, evaluate and features '
                'take it as it is; `tactile export` writes it for other programs'
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
    channels = trials.x.shape[1]
    shown = ', '.join(f'{name} {count}' for name, count in list(found.items())[:SHOWN_LABELS])
    output.say(
        f'{archive}: {len(trials)} trials of {len(found)} labels ({shown}), '
        f'{channels} channel{"s" if channels > 1 else ""}'
        f'{f" in {trials.unit}" if trials.unit else ""}, {samples} samples at '
        f'{trials.rate_hz:g} Hz; columns: {", ".join(trials.columns) or "none"}',
    )
    if plot is not None:
        output.say(f'{plot}: {min(DRAWN, len(trials))} trials')
    command = next_command(archive, trials)
    output.say(f'next: {command}')
    output.result(
        {
            'path': str(archive),
            'trials': len(trials),
            'labels': found,
            'channels': channels,
            'samples': [shortest, longest],
            'rate_hz': trials.rate_hz,
            'unit': trials.unit or None,
            'columns': list(trials.columns),
            'notes': list(trials.steps),
            'skipped': skipped,
            'next': command,
        }
    )


def next_command(archive: Path, trials: 'LabelledTrials') -> str:
    """Return the command that evaluates an archive, with sessions or mountings held out."""
    import numpy as np

    command = f'tactile evaluate {archive} --task texture (or stiffness)'
    for name in GROUPS:
        if len(np.unique(trials.columns.get(name, []))) > 1:
            return f'{command} --group {name}'
    return (
        f'{command}; no column names sessions or mountings, so random folds alone are possible, '
        'which are optimistic'
    )


def _draw(plot: Path, recording: 'Recording', trials: 'LabelledTrials') -> None:
    from tactile_lab.plots import plot_signals

    usable = [trial for trial in recording.trials if not trial.why_not]
    first = list({trial.label: trial for trial in reversed(usable)}.values())[::-1]
    chosen = [*first, *(trial for trial in usable if trial not in first)][:DRAWN]
    titled = [(f'{trial.label}, trial {trial.name}', trial.signal) for trial in chosen]
    with named_errors('write', plot):
        plot_signals(plot, titled, float(trials.lengths.min()) / trials.rate_hz)
