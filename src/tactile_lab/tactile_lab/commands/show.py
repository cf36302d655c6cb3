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

"""`tactile show`: what is in a recording, a model file or an archive, and a plot of a trial."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
import numpy as np
from rich.table import Table

from tactile_bags import EVENT, TactileBag
from tactile_bags.message_records import read_records
from tactile_classifier.datasets.archive import LabelledTrials, load_archive
from tactile_classifier.model_file.inference import TactileModel
from tactile_classifier.model_file.manifest import Manifest
from tactile_features.records import TrialEvent
from tactile_lab.commands.output import Output
from tactile_lab.datasets.tables import CLASSIFIER_TITLES, describe_features, SCALING_TITLES
from tactile_lab.datasets.traces import read_trace
from tactile_lab.plots import plot_strain, TRACE_COLOUR
from tactile_ros.errors import TactileError

SHOWN = 20
"""Trials in the terminal's table; JSON has all."""

SUFFIXES = ('.png', '.svg', '.pdf')


@dataclass(frozen=True)
class Contents:
    """What is in a file.

    Attributes
    ----------
    kind : str
        ``bag``, ``model`` or ``archive``.
    facts : dict of str to str
        What is said of the whole, by name.
    trials : list of dict
        One entry a trial, all with the same keys; a model has none.
    details : dict
        More for JSON.
    """

    kind: str
    facts: dict[str, str]
    trials: list[dict[str, Any]] = field(default_factory=list)
    details: dict[str, Any] = field(default_factory=dict)


def run_show(path: Path, plot: Path | None, trial: int, *, as_json: bool) -> None:
    """Print what is in a file, and plot one trial when a file for it is named.

    Parameters
    ----------
    path : Path
    plot : Path or None
        Where the picture goes.
    trial : int
        Number of the trial to plot, from 1.
    as_json : bool

    Raises
    ------
    TactileError
        When the file cannot be read, or has no such trial.
    """
    output = Output(as_json)
    if plot is not None and plot.suffix.lower() not in SUFFIXES:
        raise TactileError(f'{plot}: the name must end in one of {", ".join(SUFFIXES)}')
    if path.suffix == '.onnx':
        contents = describe_model(TactileModel.load(path).manifest)
    elif path.suffix == '.npz':
        archive = load_archive(path, folds=0, skip_bad=True)
        contents = describe_archive(archive)
    else:
        with TactileBag(path) as bag:
            contents = describe_bag(bag)
    if plot is not None:
        count = len(contents.trials)
        if not 1 <= trial <= count:
            raise TactileError(f'{path} has {count} trials, so there is no trial {trial}')
        try:
            if contents.kind == 'archive':
                plot_archive(plot, archive, trial)
            else:
                plot_bag(plot, path, contents.trials[trial - 1], trial)
        except OSError as error:
            raise TactileError(f'cannot write {plot}: {error.strerror}') from error
    _print(path, contents, output)
    if plot is not None:
        output.say(f'{plot}: trial {trial}')
    output.result(
        {
            'path': str(path),
            'kind': contents.kind,
            'facts': contents.facts,
            'trials': contents.trials,
            **contents.details,
        }
    )


def _print(path: Path, contents: Contents, output: Output) -> None:
    facts = Table(title=f'{contents.kind} {path}', title_justify='left', show_header=False)
    for name, value in contents.facts.items():
        facts.add_row(name, value)
    output.say(facts)
    if not contents.trials:
        return
    table = Table(*contents.trials[0])
    for entry in contents.trials[:SHOWN]:
        table.add_row(*(f'{v:.2f}' if isinstance(v, float) else str(v) for v in entry.values()))
    output.say(table)
    if len(contents.trials) > SHOWN:
        output.say(f'... and {len(contents.trials) - SHOWN} more; --json lists all')


def describe_bag(bag: TactileBag) -> Contents:
    """Return the contents of a recording."""
    trials: list[dict[str, Any]] = []
    for namespace in bag.namespaces:
        by_trial: dict[str, list[TrialEvent]] = {}
        for _, event in read_records(bag.messages(EVENT, namespace=namespace)):
            by_trial.setdefault(event.trial_id, []).append(event)
        for trial_id, events in by_trial.items():
            first, last = events[0], events[-1]
            trials.append(
                {
                    'trial': len(trials) + 1,
                    'finger': namespace,
                    'task': first.protocol,
                    'contact': first.contact,
                    'object': first.object_label,
                    'session': first.session_id,
                    'mounting': first.mounting_id,
                    'seconds': (last.stamp_ns - first.stamp_ns) * 1e-9,
                    'ended': last.phase,
                    'simulated': first.simulated,
                    'trial_id': trial_id,
                }
            )
    objects = sorted({str(entry['object']) for entry in trials})
    topics = {name: {'type': type_, 'messages': n} for name, (type_, n) in bag.topics.items()}
    facts = {
        'trials': str(len(trials)),
        'objects': ', '.join(objects) or 'none',
        'sessions': str(len({entry['session'] for entry in trials})),
        'simulated': 'SIMULATED' if any(entry['simulated'] for entry in trials) else 'no',
        'topics': '; '.join(f'{name} ({n})' for name, (_, n) in bag.topics.items()),
    }
    if bag.recovered:
        facts['not closed'] = bag.recovered
    return Contents('bag', facts, trials, {'topics': topics})


def describe_archive(archive: LabelledTrials) -> Contents:
    """Return the contents of a labelled-trials archive."""
    labels, counts = np.unique(archive.label, return_counts=True)
    seconds = archive.lengths / archive.rate_hz
    facts = {
        'trials': str(len(archive)),
        'labels': ', '.join(f'{a} ({n})' for a, n in zip(labels, counts, strict=True)),
        'sample rate': f'{archive.rate_hz:g} Hz',
        'channels': str(archive.x.shape[1]),
        'length': f'{seconds.min():.3g} to {seconds.max():.3g} s',
        'columns': ', '.join(archive.columns) or 'none',
    }
    if archive.skipped:
        facts['unusable'] = '; '.join(f'row {s.row}: {s.reason}' for s in archive.skipped[:5])
    trials = [
        {
            'trial': i + 1,
            'label': str(archive.label[i]),
            'seconds': float(seconds[i]),
            **{name: str(column[i]) for name, column in archive.columns.items()},
        }
        for i in range(len(archive))
    ]
    return Contents('archive', facts, trials)


def describe_model(manifest: Manifest) -> Contents:
    """Return the card of a model: what it takes, what it was trained on, how good it is."""
    whole, *running = manifest.parts
    score, calibration = manifest.cross_validation, manifest.calibration
    sessions = calibration.get('groups', 0)
    before, after = whole.calibration_error_before, whole.calibration_error_after
    contact = manifest.contact or 'any contact'
    facts = {
        'answers': f'{manifest.task}, {contact}: {", ".join(manifest.labels)}',
        'classifier': f'{CLASSIFIER_TITLES[manifest.classifier]}, '
        f'{SCALING_TITLES[manifest.scaling]}',
        'takes': f'{len(manifest.spec.names)} {describe_features(manifest.spec)}, from '
        f'{manifest.spec.sample_count} samples at {manifest.spec.rate_hz:g} Hz',
        'trained on': f'{manifest.trials} {"SIMULATED " * manifest.simulated}trials, '
        + (f'{sessions} sessions' if sessions else 'no sessions told apart')
        + f', {manifest.created}',
        'cross-validation': f'{100 * score["mean"]:.1f} % ± {100 * score["spread"]:.1f} over '
        f'{score["spread_of"]} ({score["split"]})'
        if score
        else 'not stated',
        'held out': f'{100 * whole.accuracy:.1f} % ({calibration["split"]})'
        if whole.accuracy >= 0.0 and 'split' in calibration
        else f'not calibrated: {calibration.get("reason", "not stated")}',
    }
    if after >= 0.0:
        facts['calibration error'] = (
            f'{100 * before:.1f} % before, {100 * after:.1f} % after'
            + ': calibration made it WORSE on held-out trials' * (after > before)
        )
    if whole.novelty_threshold >= 0.0:
        facts['unknown'] = (
            f'above novelty {whole.novelty_threshold:.2f}, at '
            f'{100 * manifest.false_alarm_rate:g} % false alarms'
        )
    if running:
        facts['running answers'] = ', '.join(
            f'{part.sample_count / manifest.spec.rate_hz:g} s {100 * part.accuracy:.1f} %'
            for part in running
        )
    limits = []
    if manifest.simulated:
        limits.append('SIMULATED trials say nothing of a real finger')
    if sessions < 2:
        limits.append('no session was held out: a new session may do worse')
    facts['limits'] = '; '.join(limits) or f'a new session beside these {sessions} may differ'
    return Contents('model', facts, details={'versions': dict(manifest.versions)})


def plot_bag(plot: Path, path: Path, entry: dict[str, Any], number: int) -> None:
    """Draw the tension of one trial of a bag with its phases."""
    with TactileBag(path) as bag:
        trace = read_trace(bag, entry['trial_id'], entry['finger'])
    title = f'trial {number}: {entry["task"]}, {entry["contact"]}, {entry["object"]}'
    simulated = 'SIMULATED, ' if entry['simulated'] else ''
    plot_strain(plot, trace.time_s, trace.tension_n, trace.phases, simulated + title)


def plot_archive(plot: Path, archive: LabelledTrials, number: int) -> None:
    """Draw all channels of one trial of an archive."""
    row = number - 1
    count = archive.lengths[row]
    figure = Figure(figsize=(9, 4), layout='constrained')
    axes = figure.subplots()
    time_s = np.arange(count) / archive.rate_hz
    for i, channel in enumerate(archive.x[row, :, :count]):
        colour = TRACE_COLOUR if i == 0 else f'C{i}'
        axes.plot(time_s, channel, color=colour, lw=1, label=f'channel {i}')
    axes.set(title=f'trial {number}: {archive.label[row]}', xlabel='time [s]', ylabel='signal')
    if 1 < archive.x.shape[1] <= 10:
        axes.legend()
    figure.savefig(plot, dpi=130)
