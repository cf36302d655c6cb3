# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report as one self-contained HTML file.

The templates contain the order of the sections and the text.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from tactile_analysis.report import drawings
from tactile_analysis.report.analysis import SetResult
from tactile_analysis.report.significance import (
    find_components,
    format_alike_pairs,
    format_least_p,
)
from tactile_analysis.report.summary import (
    find_versions,
    format_accuracy,
    format_classifier,
    format_first_sentence,
    format_learning_curve,
    format_model,
    format_reliability,
    Source,
)
from tactile_analysis.wording import format_interval, format_warnings
from tactile_classifier.coverage import format_coverage
from tactile_classifier.evaluation.open_set import OpenSetEvaluation
from tactile_classifier.evaluation.reliability import DRAWS
from tactile_classifier.model_file.manifest import format_features
from tactile_classifier.types import CLASSIFIER_TITLES, short_scaling
from tactile_ros.errors import named_errors

TITLE = 'Touch through the tendon: evaluation'
FILE_NAME = 'report.html'


def report_path(path: Path) -> Path:
    """Return the HTML file of a report, and create its folder.

    ``path`` is the HTML file, or a folder, in which the file is named `FILE_NAME`. Raises
    `TactileError` when the file cannot be written.
    """
    file = path if path.suffix.lower() in ('.html', '.htm') else path / FILE_NAME
    with named_errors('write the report', file):
        file.parent.mkdir(parents=True, exist_ok=True)
        existed = file.exists()
        file.open('a').close()  # raises before the evaluation, which takes long
        if not existed:
            file.unlink()
    return file


def build_page(
    results: Sequence[SetResult], sources: Sequence[Source], settings: Mapping[str, str]
) -> str:
    """Return the report as HTML, with the settings and the versions of the libraries.

    The templates escape all text. They call the functions in `_FUNCTIONS`, which return the texts
    and figures.
    """
    environment = Environment(
        loader=PackageLoader('tactile_analysis.report'),
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
    environment.globals |= {each.__name__: each for each in _FUNCTIONS}
    return environment.get_template('report.html').render(
        title=TITLE,
        simulated=any(result.recordings.simulated for result in results),
        results=results,
        sources=sources,
        settings=settings,
        versions=find_versions(),
        calibration_draws=DRAWS,
        contents=[],
    )


def format_split(result: SetResult, each: OpenSetEvaluation) -> str:
    """Return task, classifier and split of an evaluation of unknown objects."""
    return f'{result.recordings.table.task}: {format_classifier(each)}, {each.split}'


_FUNCTIONS: Sequence[Callable[..., Any]] = (
    drawings.draw_accuracies,
    drawings.draw_confusion,
    drawings.draw_headline_confusion,
    drawings.draw_learning_curve,
    drawings.draw_open_set,
    drawings.draw_reliability,
    drawings.draw_signals,
    drawings.draw_significance,
    drawings.draw_split_accuracies,
    find_components,
    format_accuracy,
    format_alike_pairs,
    format_coverage,
    format_features,
    format_first_sentence,
    format_learning_curve,
    format_least_p,
    format_model,
    format_reliability,
    format_split,
    format_warnings,
)
