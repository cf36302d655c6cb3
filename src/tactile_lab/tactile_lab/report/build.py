# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report as one HTML file that needs no other; its order and its prose are the templates'."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from tactile_classifier.evaluation.early_answers import StoppingEvaluation
from tactile_classifier.evaluation.open_set import OpenSetEvaluation
from tactile_classifier.model_file.manifest import format_features
from tactile_classifier.records import CLASSIFIER_TITLES, short_scaling
from tactile_lab.datasets.tables import format_interval, format_warnings
from tactile_lab.output import named_errors
from tactile_lab.report import drawings
from tactile_lab.report.analysis import SetResult
from tactile_lab.report.answers import MeasureSummary
from tactile_lab.report.published import compare_with_paper, format_design, is_the_papers
from tactile_lab.report.significance import find_components, format_alike_pairs
from tactile_lab.report.summary import (
    find_versions,
    format_accuracy,
    format_first_sentence,
    format_model,
    Source,
)

TITLE = 'Touch through the tendon: evaluation'
FILE_NAME = 'report.html'

_SHOWN_UNITS = {'m': ('mm', 1e3), 'N/m': ('N/mm', 1e-3)}


def report_path(path: Path) -> Path:
    """Return the file that a report goes to: itself, or one of a folder, which is made."""
    file = path if path.suffix.lower() in ('.html', '.htm') else path / FILE_NAME
    with named_errors('write the report', file):
        file.parent.mkdir(parents=True, exist_ok=True)
        existed = file.exists()
        file.open('a').close()  # before the work, not after it
        if not existed:
            file.unlink()
    return file


def write_report(
    file: Path,
    results: Sequence[SetResult],
    sources: Sequence[Source],
    settings: Mapping[str, str],
) -> None:
    """Write the report of some recordings into a file."""
    page = build_page(results, sources, settings, find_versions())
    file.write_text(page, encoding='utf-8')


def build_page(
    results: Sequence[SetResult],
    sources: Sequence[Source],
    settings: Mapping[str, str],
    versions: Mapping[str, str],
) -> str:
    """Return the report as HTML; ``settings`` and ``versions`` are what the numbers depend on."""
    holds = [result for result in results if result.units]
    return fill_template(
        'report.html',
        title=TITLE,
        simulated=any(result.recordings.simulated for result in results),
        results=results,
        sets=[_summarise(result) for result in results],
        signals=[
            drawing
            for result in results
            for drawing in drawings.draw_signals(
                result, find_components(result.recordings.table.spec)
            )
        ],
        accuracies=drawings.draw_accuracies(results),
        confusions=[drawings.draw_confusion(result) for result in results],
        scaling_cause=drawings.draw_scaling_cause(holds) if holds else None,
        significance=list(drawings.draw_significance(results)),
        alike_pairs=[
            format_alike_pairs(result, components)
            for result in results
            if not result.units
            and (components := find_components(result.recordings.table.spec)) is not None
        ],
        sources=sources,
        settings=settings,
        versions=versions,
        **_compare([result for result in results if is_the_papers(result)]),
        **_answer(results),
    )


def fill_template(name: str, **values: Any) -> str:
    """Return a page from a template of the folder ``templates``; all text is escaped."""
    environment = Environment(
        loader=PackageLoader('tactile_lab.report'),
        autoescape=True,
        extensions=['jinja2.ext.do'],
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters: dict[str, Callable[..., str]] = {
        'percent': lambda share: f'{100 * share:.1f}',
        'interval': format_interval,
        'classifier': CLASSIFIER_TITLES.__getitem__,
        'scaling': short_scaling,
    }
    environment.filters |= filters
    return environment.get_template(name).render(values, contents=[])


def _summarise(result: SetResult) -> dict[str, Any]:
    return {
        'title': result.recordings.title,
        'simulated': result.recordings.simulated,
        'first_sentence': format_first_sentence(result),
        'pictures': [drawings.draw_split_accuracies(result), drawings.draw_answers(result)],
        'facts': [
            format_model(result),
            format_accuracy(result),
            *format_warnings(result.evaluations),
        ],
        'features': format_features(result.recordings.table.spec),
        'preparation': result.recordings.format_preparation(),
        'table_sha256': result.recordings.table.compute_sha256(),
    }


def _compare(results: Sequence[SetResult]) -> dict[str, Any]:
    return {
        'comparisons': compare_with_paper([result.as_published for result in results])
        if results
        else [],
        'design': format_design(results) if results else '',
        'compared_split': results[0].plain.split if results else '',
        'others_features': any(result.published for result in results),
    }


def _answer(results: Sequence[SetResult]) -> dict[str, Any]:
    """Return the values of the sections on answers besides a label; empty lists without these."""
    answered = [(result, result.answers) for result in results if result.answers is not None]
    stopping = [(r, a.stopping) for r, a in answered if a.stopping is not None]
    return {
        'open_sets': [
            {
                'result': result,
                'found': answers.open_set,
                'drawing': drawings.draw_open_set(result, answers.open_set),
                'split': _format_split(result, answers.open_set),
            }
            for result, answers in answered
            if answers.open_set is not None
        ],
        'stopping': [
            {'result': result, 'found': found, 'split': _format_split(result, found)}
            for result, found in stopping
        ],
        'stopping_drawing': drawings.draw_stopping(stopping) if stopping else None,
        'measures': [
            {
                'result': result,
                'rows': [_format_measure(each) for each in answers.measures],
                'unmeasured': list_unmeasured(answers.measures),
            }
            for result, answers in answered
            if answers.measures
        ],
    }


def _format_split(result: SetResult, each: OpenSetEvaluation | StoppingEvaluation) -> str:
    return (
        f'{result.recordings.table.task}: {CLASSIFIER_TITLES[each.classifier]}, '
        f'{short_scaling(each.scaling)}, {each.split}'
    )


def _format_measure(each: MeasureSummary) -> list[str]:
    unit, factor = _SHOWN_UNITS.get(each.unit, (each.unit, 1.0))
    numbers = (each.median, each.spread, each.standard_uncertainty)
    absent = 'too few' if each.measured else 'none'
    return [
        f'{each.name.replace("_", " ")} [{unit}]',
        each.label,
        f'{each.measured} of {each.trials}',
        *(absent if number is None else f'{factor * number:.3f}' for number in numbers),
    ]


def list_unmeasured(summaries: Sequence[MeasureSummary]) -> list[str]:
    """Return why there are trials without a value: a sentence for each measure and reason."""
    labels: dict[tuple[str, str], list[str]] = {}
    for each in summaries:
        if each.reason:
            missing = f'{each.label} ({each.trials - each.measured} of {each.trials})'
            labels.setdefault((each.name.replace('_', ' '), each.reason), []).append(missing)
    return [
        f'No {name} of {", ".join(found)}, most often because: {reason}.'
        for (name, reason), found in labels.items()
    ]
