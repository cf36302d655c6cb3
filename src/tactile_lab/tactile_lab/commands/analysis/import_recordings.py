# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile import`: recordings of others as one labelled-trials archive."""

from __future__ import annotations

import numpy as np

from tactile_bags.recording import Recording
from tactile_classifier.datasets.archive import save_archive
from tactile_lab.commands.analysis.requests import ImportRequest
from tactile_lab.commands.output import Output, refuse_to_replace
from tactile_ros.errors import TactileError


def run_import(request: ImportRequest, *, as_json: bool) -> None:
    """Read recordings, say what was taken for what, write the archive.

    Raises
    ------
    TactileError, DatasetError
        When something is not known and cannot be asked, or the archive would be replaced.
    """
    output = Output(as_json)
    archive = request.archive
    if archive.suffix != '.npz':
        raise TactileError(f'--output is {archive}; the name of an archive ends in .npz')
    refuse_to_replace([archive], force=request.force)
    with Recording.load(request.recordings, request.sources) as recording:
        if recording.is_own:
            raise TactileError(
                f'{recording.paths[0]} is a bag with trial events: train, evaluate and features '
                'take it as it is'
            )
        trials = recording.to_arrays(skip_bad=request.skip_bad)
    for line in trials.steps:
        output.say(line, plain=True)
    for each in trials.skipped:
        output.say(f'left out: row {each.row}: {each.reason}', plain=True)
    labels, counts = np.unique(trials.label, return_counts=True)
    found = {str(label): int(count) for label, count in zip(labels, counts, strict=True)}
    try:
        save_archive(archive, trials)
    except OSError as error:
        raise TactileError(f'cannot write {archive}: {error.strerror}') from error
    shortest, longest = int(trials.lengths.min()), int(trials.lengths.max())
    samples = f'{shortest}' if shortest == longest else f'{shortest} to {longest}'
    channels = trials.x.shape[1]
    output.say(
        f'{archive}: {len(trials)} trials of {len(found)} labels '
        f'({", ".join(f"{label} {count}" for label, count in list(found.items())[:12])}), '
        f'{channels} channel{"s" if channels > 1 else ""}, {samples} samples at '
        f'{trials.rate_hz:g} Hz; columns: {", ".join(trials.columns) or "none"}',
        plain=True,
    )
    output.say(f'next: tactile evaluate {archive} --task texture (or stiffness)')
    output.result(
        {
            'path': str(archive),
            'trials': len(trials),
            'labels': found,
            'channels': channels,
            'samples': [shortest, longest],
            'rate_hz': trials.rate_hz,
            'columns': list(trials.columns),
            'notes': list(trials.steps),
            'skipped': [{'row': each.row, 'reason': each.reason} for each in trials.skipped],
        }
    )
