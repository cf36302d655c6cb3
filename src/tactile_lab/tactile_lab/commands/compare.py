# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile compare`: which of two models is better on the same trials, with paired intervals."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Optional, TYPE_CHECKING

import typer

from tactile_lab import options
from tactile_lab.console import Table
from tactile_lab.output import Output
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_classifier.evaluation.model_comparison import Answered, Comparison
    from tactile_lab.datasets.model_pairs import Compared

CONFUSIONS = 5
"""Confusions in the terminal; JSON has all."""


def compare(
    model_a: Annotated[
        Path,
        typer.Argument(
            exists=True, help='Model file, or a folder of them as `tactile train` writes.'
        ),
    ],
    model_b: Annotated[Path, typer.Argument(exists=True, help='The other one.')],
    recordings: options.RecordingsArgument,
    task: options.TaskOption = None,
    contact: Annotated[
        Optional[str],
        typer.Option(
            **options.choice('flexion', 'abduction'),
            help='Compare only the models for this contact. Bags with trial events state it.',
        ),
    ] = None,
    group: Annotated[
        Optional[str],
        typer.Option(
            help='Columns that make a group of trials, with commas, for the interval. '
            'Default: session_id.'
        ),
    ] = None,
    unseen: Annotated[
        bool,
        typer.Option('--unseen', help='Leave out trials that one of the models was trained on.'),
    ] = False,
    archives: options.ArchiveOptions = options.ARCHIVES,
    statements: options.Statements = options.STATEMENTS,
    as_json: options.JsonOption = False,
) -> None:
    """Say which of two models is better, and whether the difference is more than chance.

    As in: tactile compare old/texture_flexion.npz new/texture_flexion.npz bags/new_session

    Each model classifies every trial with its own features. "unknown" counts as wrong. The
    difference of the accuracies has a paired 95 % interval: Student's t over the sessions, each of
    which counts once, or with one session Tango's score interval over the trials. The table also
    shows rejected trials and file sizes. Below it are the confusions in which the models differ
    most, and the time of one classification by B against that by A.

    Use trials that neither model was trained on. The command warns of others: most model files
    state which trials they were trained on. Two folders of models are compared file by file, for
    each task and contact.
    """
    from tactile_bags.sources.files import SourceOptions
    from tactile_lab.datasets.feature_tables import load_recording
    from tactile_lab.datasets.model_pairs import (
        compare_pair,
        load_models,
        pair_models,
        question_of,
        reader_of,
    )
    from tactile_lab.datasets.reading import Reading

    output = Output(as_json)
    reading = Reading(**vars(archives))
    models = [load_models(path, task, contact) for path in (model_a, model_b)]
    pairs, alone = pair_models(*models)
    found = []
    with (
        load_recording(recordings, SourceOptions(**vars(statements))) as recording,
        output.progress('comparing') as show,
    ):
        read = reader_of(recording, reading, pairs)
        for number, pair in enumerate(pairs, 1):
            compared = compare_pair(read, pair, options.split(group), unseen=unseen)
            if not compared:
                alone.append(f'no labelled trials of {question_of(pair)} in these recordings')
            found += compared
            show(number, len(pairs))
    if not found:
        raise TactileError('; '.join(alone))
    for each in found:
        _print(each, output)
    output.say(*alone)
    output.result({'comparisons': [each.to_dict() for each in found], 'left_out': alone})


def _print(compared: 'Compared', output: Output) -> None:
    from tactile_lab.datasets.model_pairs import SIDES

    comparison = compared.comparison
    sides = (comparison.a, comparison.b)
    titles = (f'{side}: {c.title}' for side, c in zip(SIDES, compared.contenders, strict=True))
    table = Table('', *titles, title=compared.title, right_from=1)
    table.add_row('features', *(each.model.spec.feature_set for each in compared.contenders))
    table.add_row('named correctly', *map(_format_accuracy, sides))
    table.add_row('right, where it gives a label', *map(_format_answered, sides))
    table.add_row('unknown', *(f'{100 * side.unknown_rate:.1f} %' for side in sides))
    table.add_row('no answer', *(f'{100 * side.no_answer_rate:.1f} %' for side in sides))
    table.add_row('only this one is right', str(comparison.only_a), str(comparison.only_b))
    table.add_row('file', *(f'{each.size_bytes / 1024:.0f} KiB' for each in compared.contenders))
    output.say(table)
    ratio = compared.seconds[1] / compared.seconds[0]
    lines = [
        *(f'{side}: {each.path}' for side, each in zip(SIDES, compared.contenders, strict=True)),
        _format_difference(comparison),
        f'same answer: {100 * comparison.agreement:.1f} % of the trials',
        f'time of one answer, B to A, features apart: {ratio:.2f}',
        *(
            f'{wrong.label}: {wrong.answer} is the answer of A in {wrong.count_a}, of B in '
            f'{wrong.count_b} of {wrong.trials} trials'
            for wrong in comparison.confusions[:CONFUSIONS]
        ),
    ]
    if compared.new_labels:
        new: Mapping[str, Any] = compared.new_labels
        lines.append(
            f'labels that neither knows ({", ".join(new["labels"])}; {new["trials"]} trials, '
            f'not counted above): unknown to A {100 * new["unknown_rate_a"]:.0f} %, to B '
            f'{100 * new["unknown_rate_b"]:.0f} %'
        )
    lines += filter(None, [compared.left_out])
    lines += (f'warning: {warning}' for warning in compared.warnings)
    output.say(*(f'  {line}' for line in lines))
    output.say(compared.verdict, '')


def _format_difference(comparison: 'Comparison') -> str:
    """Return where the interval of the difference comes from."""
    if comparison.interval.reason:
        return f'difference: no interval, {comparison.interval.reason}'
    over = comparison.interval.method
    if over.startswith('t over'):
        return f'difference: 95 % interval, {over}; shares are means over these'
    return f'difference: 95 % interval, {over}; p {comparison.p_value:.2g} (McNemar)'


def _format_accuracy(side: 'Answered') -> str:
    accuracy = f'{100 * side.accuracy:.1f} %'
    if side.interval.reason:
        return accuracy
    from tactile_lab.datasets.tables import format_interval

    return f'{accuracy}  ({format_interval(side.interval)})'


def _format_answered(side: 'Answered') -> str:
    share = side.answered_accuracy
    return 'it gives none' if share is None else f'{100 * share:.1f} %'
