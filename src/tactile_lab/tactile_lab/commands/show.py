# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile show`: list the contents of a recording or a model file, and plot trials."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Optional, TYPE_CHECKING

import typer

from tactile_lab import options
from tactile_lab.console import Cell, Prose, Table
from tactile_lab.output import Output, PICTURES, refuse_suffix
from tactile_ros.errors import named_errors, TactileError

if TYPE_CHECKING:
    from tactile_analysis import TrialSet
    from tactile_bags import RecordedBag, Trial

SPARE = ('simulated', 'mounting', 'ended', 'finger', 'contact', 'session', 'task', 'seconds')
"""Columns of bags that are hidden on a narrow terminal, the least important first."""

SHOWN = 20
"""Number of trials in the table on the terminal; ``--json`` prints all."""


class Contents(NamedTuple):
    """Contents of a recording or a model.

    ``facts`` are properties of the whole recording or model. ``trials`` has a dictionary for each
    trial, all with the same keys; for a model it is empty. ``details`` are printed only with
    ``--json``.
    """

    kind: str
    facts: dict[str, Cell]
    trials: list[dict[str, Any]]
    details: dict[str, Any]


def show(
    path: Annotated[
        Path,
        typer.Argument(
            exists=True,
            help='A bag, the folder of an experiment, a model file (.npz), an archive (.npz), or '
            'another recording whose files state rate and columns.',
        ),
    ],
    plot: Annotated[
        Optional[Path],
        typer.Option(metavar='FILE', help='Draw trials to this file: .png, .svg or .pdf.'),
    ] = None,
    trial: Annotated[
        Optional[int],
        typer.Option(
            min=1,
            help='Number of the trial to draw; the first is 1. Default: the first trial; for an '
            'experiment all trials, with one row per object, one colour per session, and excluded '
            'trials in grey.',
        ),
    ] = None,
    topics: Annotated[
        bool, typer.Option('--topics', help='List the topics of a bag, too.')
    ] = False,
    as_json: options.JsonOption = False,
) -> None:
    """List the contents of a recording, a model file or an archive.

    For a recording, prints its trials with label, session and length. For a model, prints its
    features, training trials, accuracy on held-out trials, calibration error and limits.
    """
    from tactile_features.model_container import is_model_file

    output = Output(as_json)
    if plot is not None:
        refuse_suffix('--plot', plot, PICTURES)
    if path.suffix == '.onnx' or is_model_file(path):
        contents = describe_card(path)
        if plot is not None:
            raise TactileError(f'{path} has 0 trials, so there is no trial {trial or 1}')
    else:
        with _open(path) as recording:
            contents = describe_recording(recording)
            if plot is not None:
                drawn = _draw(plot, path, recording, trial)
    _print(path, contents, output, with_topics=topics)
    if plot is not None:
        output.say(f'{plot}: {drawn}')
    facts = {
        name: value if isinstance(value, str) else ', '.join(value)
        for name, value in contents.facts.items()
    }
    found = {'kind': contents.kind, 'facts': facts, 'trials': contents.trials}
    output.result({'path': str(path), **found, **contents.details})


def _open(path: Path) -> 'TrialSet':
    from tactile_analysis.sources.files import find_leaves, SourceKind
    from tactile_analysis.trial_set import OWN, TrialSet
    from tactile_bags.experiment_journal import is_experiment
    from tactile_bags.recorded_bag import RecordedBag

    inside = sorted([p.parent for p in path.glob('*/metadata.yaml')] + [*path.glob('*.npz')])
    if inside and not (path / 'metadata.yaml').exists() and not is_experiment(path):
        raise TactileError(
            f'{path} is a folder of {len(inside)} recordings or models; name one, such as '
            f'{inside[0]}'
        )
    (leaf, *more) = find_leaves([path])
    # TrialSet.load refuses a bag without trials.
    if not more and leaf.kind is SourceKind.BAG and leaf.path == path:
        return TrialSet(OWN, path.name, [path], bags=[RecordedBag(path)])
    return TrialSet.load(path)


def describe_recording(recording: 'TrialSet') -> Contents:
    """Return the contents of a recording."""
    if recording.kind == 'archive':
        return _describe_archive(recording)
    trials = [_describe_trial(number, each) for number, each in enumerate(recording.trials, 1)]
    sessions = {each.session_id for each in recording.trials}
    tasks = sorted({each.task for each in recording.trials if each.task})
    facts: dict[str, Cell] = {
        'trials': str(len(trials)),
        'task': tasks or 'not stated',
        'rate': f'{recording.rate_hz:g} Hz' if recording.rate_hz else 'not known',
        **_describe_duration(recording.bags),
        'objects': sorted({each.label for each in recording.trials}) or 'none',
        'sessions': str(len(sessions)),
        'simulated': 'SIMULATED' if any(t.simulated for t in recording.trials) else 'no',
        'unit': recording.unit or 'unknown',
    }
    topics: dict[str, Any] = {}
    if left_out := sum(bool(each.why_not) for each in recording.trials):
        facts['excluded'] = str(left_out)
    for bag in recording.bags:
        for name, (kind, count) in bag.topics.items():
            known = topics.setdefault(name, {'type': kind, 'messages': 0})
            known['messages'] += count
        if bag.recovered:
            facts['not closed'] = Prose(bag.recovered)
    if topics:
        count = sum(topic['messages'] for topic in topics.values())
        facts['topics'] = Prose(f'{len(topics)}, with {count} messages (--topics lists them)')
    kind = 'bag' if recording.is_own else recording.kind
    return Contents(kind, facts, trials, {'topics': topics, 'notes': recording.notes})


def _describe_duration(bags: 'Sequence[RecordedBag]') -> dict[str, Cell]:
    """Return the total duration of the bags as an entry of `Contents.facts`; empty without bags.

    The duration of a bag is the time from its first to its last message.
    """
    duration_s = 0.0
    for bag in bags:
        if (first := next(iter(bag.messages()), None)) is not None:
            duration_s += (bag.end_ns - first.received_at_ns) / 1e9
    return {'duration': f'{duration_s:.1f} s'} if bags else {}


def _describe_trial(number: int, trial: 'Trial') -> dict[str, Any]:
    if trial.events:
        ended, length_s = trial.events[-1].phase, trial.phases[-1][2] if trial.phases else 0.0
    else:
        time_s = trial.signal.time_s
        ended, length_s = '', 0.0 if time_s is None else float(time_s[-1] - time_s[0])
    return {
        'trial': number,
        'finger': trial.namespace,
        'task': trial.task,
        'contact': trial.contact,
        'object': trial.label,
        'session': trial.session_id,
        'mounting': trial.mounting_id,
        'seconds': length_s,
        'ended': ended,
        'excluded': trial.why_not,
        'simulated': trial.simulated,
        'trial_id': trial.name,
    }


def _describe_archive(recording: 'TrialSet') -> Contents:
    included = recording.included
    if not included:
        recording.even(skip_bad=True)  # raises the error with the reason
    signals = [trial.signal for trial in included]
    seconds = [signal.values.shape[1] / (signal.rate_hz or 1.0) for signal in signals]
    counts = sorted(Counter(trial.label for trial in included).items())
    columns = [name for name in included[0].columns if name != 'label']
    facts: dict[str, Cell] = {
        'trials': str(len(included)),
        'labels': [f'{label} ({n})' for label, n in counts],
        'sample rate': f'{signals[0].rate_hz:g} Hz',
        'unit': recording.unit or 'unknown',
        'channels': str(len(signals[0].channels)),
        'length': f'{min(seconds):.3g} to {max(seconds):.3g} s',
        'columns': columns or 'none',
    }
    if recording.skipped:
        facts['unusable'] = Prose('; '.join(recording.skipped[:5]))
    own = {'trial', 'label', 'seconds'}
    trials = [
        {
            'trial': i + 1,
            'label': trial.label,
            'seconds': seconds[i],
            **{
                f'column {name}' if name in own else name: str(trial.columns[name])
                for name in columns
            },
        }
        for i, trial in enumerate(included)
    ]
    return Contents('archive', facts, trials, {})


def describe_card(path: Path) -> Contents:
    """Return the contents of a model file, with its model card."""
    from tactile_classifier.model_file.manifest import list_facts, list_limits
    from tactile_classifier.model_file.model import load_model

    model = load_model(path)
    details = {
        'card': model.card,
        'limits': list_limits(model.manifest),
        'model_id': model.model_id,
        'versions': dict(model.manifest.versions),
    }
    return Contents('model', {**list_facts(model.manifest)}, [], details)


def _draw(plot: Path, path: Path, recording: 'TrialSet', trial: Optional[int]) -> str:
    """Draw one trial, or all trials of an experiment; return a text such as ``trial 1``."""
    from tactile_analysis.plots import plot_all_trials, plot_signals, plot_strain
    from tactile_bags.experiment_journal import is_experiment

    trials = [t for t in recording.trials if recording.is_own or not t.why_not]
    with named_errors('write', plot):
        if trial is None and is_experiment(path):
            plot_all_trials(plot, trials)
            return f'{len(trials)} trials'
        number = trial or 1
        if number > len(trials):
            raise TactileError(f'{path} has {len(trials)} trials, so there is no trial {number}')
        chosen = trials[number - 1]
        known = filter(None, (chosen.task, chosen.contact, chosen.label))
        title = f'trial {number}: {", ".join(known)}'
        title = ('SIMULATED, ' if chosen.simulated else '') + title
        if chosen.events:
            signal = chosen.signal
            assert signal.time_s is not None
            plot_strain(plot, signal.time_s, signal.values[0], chosen.phases, title)
        else:
            plot_signals(plot, [(title, chosen.signal)])
    return f'trial {number}'


def _print(path: Path, contents: Contents, output: Output, *, with_topics: bool = False) -> None:
    if 'card' in contents.details:
        model_id, card = contents.details['model_id'], contents.details['card']
        output.say(f'{path}: {model_id}', card)
        return
    facts = Table(title=f'{contents.kind} {path}')
    for name, value in contents.facts.items():
        facts.add_row(name, value)
    output.say(facts)
    if with_topics and (topics := contents.details.get('topics')):
        table = Table('topic', 'messages', 'type', spare=['type'])
        for name, topic in topics.items():
            table.add_row(name, str(topic['messages']), topic['type'])
        output.say(table)
    if not contents.trials:
        return
    shown, same = _split_columns(contents.trials)
    # Further columns of an archive are hidden first, beginning with the last one.
    own = ('trial', 'label', 'object', 'seconds', 'excluded', 'trial_id')
    spare = [name for name in SPARE if name in shown]
    spare = [*reversed([name for name in shown if name not in (*own, *SPARE)]), *spare]
    table = Table(*shown, spare=spare)
    for entry in contents.trials[:SHOWN]:
        table.add_row(*(_format_cell(name, entry[name]) for name in shown))
    output.say(table)
    if same:
        output.say(f'all trials: {same}')
    if len(contents.trials) > SHOWN:
        output.say(f'... and {len(contents.trials) - SHOWN} more; --json lists all')


def _split_columns(trials: Sequence[dict[str, Any]]) -> tuple[list[str], str]:
    """Return the columns to print, and the values that all trials have in common as text."""
    names = list(trials[0])
    values = {name: {_format_value(entry[name]) for entry in trials} for name in names}
    same = {name: found.pop() for name, found in values.items() if len(found) == 1}
    if len(trials) == 1:
        return names, ''
    stated = (f'{name} {value}' for name, value in same.items() if value)
    return [name for name in names if name not in same], ', '.join(stated)


def _format_cell(name: str, value: Any) -> Cell:
    text = _format_value(value)
    return Prose(text) if name == 'excluded' else text


def _format_value(value: Any) -> str:
    if value is None:
        return ''
    if isinstance(value, bool):
        return 'yes' if value else 'no'
    return f'{value:.2f}' if isinstance(value, float) else str(value)
