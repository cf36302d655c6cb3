# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

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
from tactile_classifier.model_file.card import describe_model, list_limits
from tactile_classifier.model_file.inference import read_model_card, TactileModel
from tactile_features.records import TrialEvent
from tactile_lab.commands.output import Output
from tactile_lab.datasets.traces import read_trace
from tactile_lab.plots import plot_strain, TRACE_COLOUR
from tactile_ros.errors import TactileError

SHOWN = 20
"""Trials in the terminal's table; JSON has all."""

SUFFIXES = ('.png', '.svg', '.pdf')


@dataclass(frozen=True)
class Contents:
    """Contents of a ``bag``, ``model`` or ``archive``.

    ``facts`` describe the whole. The ``trials`` share their keys; a model has none. ``details``
    are for JSON.
    """

    kind: str
    facts: dict[str, str]
    trials: list[dict[str, Any]] = field(default_factory=list)
    details: dict[str, Any] = field(default_factory=dict)


def run_show(path: Path, plot: Path | None, trial: int, *, as_json: bool) -> None:
    """Print what is in a file, and plot a trial, numbered from 1, when a file for it is named.

    Raises
    ------
    TactileError
        When the file cannot be read, or has no such trial.
    """
    output = Output(as_json)
    if plot is not None and plot.suffix.lower() not in SUFFIXES:
        raise TactileError(f'{plot}: the name must end in one of {", ".join(SUFFIXES)}')
    if path.suffix == '.onnx':
        contents = describe_card(path)
    elif path.suffix == '.npz':
        archive = load_archive(path, folds=0, skip_bad=True)
        contents = describe_archive(archive)
    else:
        _refuse_collection(path)
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
    if 'card' in contents.details:
        output.say(f'{path}: {contents.details["model_id"]}', plain=True)
        output.say(contents.details['card'], plain=True)
        return
    facts = Table(title=f'{contents.kind} {path}', title_justify='left', show_header=False)
    for name, value in contents.facts.items():
        facts.add_row(name, value)
    output.say(facts)
    if not contents.trials:
        return
    shown, same = _split_columns(contents.trials)
    table = Table(*shown)
    for entry in contents.trials[:SHOWN]:
        table.add_row(*(_tell_value(entry[name]) for name in shown))
    output.say(table)
    if same:
        output.say(f'all trials: {same}', plain=True)
    if len(contents.trials) > SHOWN:
        output.say(f'... and {len(contents.trials) - SHOWN} more; --json lists all')


def _split_columns(trials: list[dict[str, Any]]) -> tuple[list[str], str]:
    """Return the columns of the terminal's table, and what all trials have in common.

    ``trial_id`` is in JSON alone: it would leave no room for the others.
    """
    names = [name for name in trials[0] if name != 'trial_id']
    values = {name: {_tell_value(entry[name]) for entry in trials} for name in names}
    same = {name: found.pop() for name, found in values.items() if len(found) == 1}
    if len(trials) == 1:
        return names, ''
    stated = (f'{name} {value}' for name, value in same.items() if value)
    return [name for name in names if name not in same], ', '.join(stated)


def _tell_value(value: Any) -> str:
    if isinstance(value, bool):
        return 'yes' if value else 'no'
    return f'{value:.2f}' if isinstance(value, float) else str(value)


def describe_bag(bag: TactileBag) -> Contents:
    """Return the contents of a recording."""
    trials: list[dict[str, Any]] = []
    for namespace in bag.namespaces:
        is_simulated = bag.metadata.get('simulated') is True
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
                    'simulated': is_simulated or any(event.simulated for event in events),
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
    own = {'trial', 'label', 'seconds'}
    trials = [
        {
            'trial': i + 1,
            'label': str(archive.label[i]),
            'seconds': float(seconds[i]),
            **{
                f'column {name}' if name in own else name: str(column[i])
                for name, column in archive.columns.items()
            },
        }
        for i in range(len(archive))
    ]
    return Contents('archive', facts, trials)


def describe_card(path: Path) -> Contents:
    """Return the card of a model file, and its facts."""
    model = TactileModel.load(path)
    details = {
        'card': read_model_card(path),
        'limits': list_limits(model.manifest),
        'model_id': model.model_id,
        'versions': dict(model.manifest.versions),
    }
    return Contents('model', describe_model(model.manifest), details=details)


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


def _refuse_collection(path: Path) -> None:
    """Refuse a folder of bags or models; `tactile show` takes one of them."""
    inside = sorted([p.parent for p in path.glob('*/metadata.yaml')] + [*path.glob('*.onnx')])
    if inside and not (path / 'metadata.yaml').exists():
        raise TactileError(
            f'{path} is a folder of {len(inside)} recordings or models; name one, such as '
            f'{inside[0]}'
        )
