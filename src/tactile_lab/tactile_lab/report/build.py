# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The order of the report: what stands where, and under which sentence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from tactile_classifier.evaluation.cross_validation import Evaluation
from tactile_classifier.evaluation.feature_selection import SelectionResult
from tactile_classifier.names import CLASSIFIER_TITLES, describe_features, short_scaling
from tactile_lab.datasets.tables import tell_interval, tell_warnings
from tactile_lab.report.analysis import SetResult
from tactile_lab.report.answer_sections import add_answers
from tactile_lab.report.components import find_components
from tactile_lab.report.figures import accuracy as figures_accuracy
from tactile_lab.report.figures import signals as figures_signals
from tactile_lab.report.figures.drawing import Drawing
from tactile_lab.report.figures.significance import (
    draw_mean_p,
    draw_p_matrices,
    explain_mean_p,
)
from tactile_lab.report.figures.summary import draw_summary
from tactile_lab.report.page import Page
from tactile_lab.report.provenance import describe_sources, find_versions, Source
from tactile_lab.report.published import compare_with_paper, is_the_papers, tell_design
from tactile_lab.report.summary import tell_accuracy
from tactile_ros.errors import TactileError

TITLE = 'Touch through the tendon: evaluation'
FILE_NAME = 'report.html'


def report_path(path: Path) -> Path:
    """Return the file that a report goes to: itself, or one of a folder, which is made.

    Raises
    ------
    TactileError
        When no report can be written there.
    """
    file = path if path.suffix.lower() in ('.html', '.htm') else path / FILE_NAME
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        existed = file.exists()
        file.open('a').close()  # before the work, not after it
        if not existed:
            file.unlink()
    except OSError as error:
        raise TactileError(f'cannot write the report {file}: {error.strerror}') from error
    return file


def write_report(
    file: Path,
    results: Sequence[SetResult],
    recordings: Sequence[Path],
    settings: Mapping[str, str],
) -> None:
    """Write the report of some recordings into a file."""
    page = build_page(results, describe_sources(recordings), settings, find_versions())
    file.write_text(page, encoding='utf-8')


def build_page(
    results: Sequence[SetResult],
    sources: Sequence[Source],
    settings: Mapping[str, str],
    versions: Mapping[str, str],
) -> str:
    """Return the report as HTML.

    Parameters
    ----------
    sources : sequence of Source
        The recordings.
    settings, versions : mapping of str to str
        What the numbers depend on besides.
    """
    page = Page(TITLE, simulated=any(result.recordings.simulated for result in results))
    for result in results:
        page.heading(result.recordings.title)
        page.drawing(draw_summary(result))
        page.items([tell_accuracy(result), *tell_warnings(result.evaluations)])
    _add_figures(page, 'What the finger felt', _signals(results), folded=False)
    _add_accuracy(page, results)
    _add_comparison(page, [result for result in results if is_the_papers(result)])
    holds = [result for result in results if result.units]
    if holds:
        page.heading('What scaling does on stiffness', folded=True)
        page.drawing(figures_accuracy.draw_scaling_cause(holds))
    _add_figures(
        page, 'What is taken for what', (figures_accuracy.draw_confusion(r) for r in results)
    )
    _add_figures(page, 'Which features tell the classes apart', _significance(results))
    _explain_significance(page, results)
    _add_selection(page, results)
    add_answers(page, results)
    _add_provenance(page, results, sources, settings, versions)
    return page.to_html()


def _add_comparison(page: Page, results: Sequence[SetResult]) -> None:
    if not results:
        return
    page.heading('Beside the paper', folded=True)
    page.paragraph(
        'Cheng et al., "Tactile Sensing with a Tendon-Driven Soft Robotic Finger", section IV: '
        'what its text states, and whether these trials agree by the rule beside it. The paper '
        'does not say whether it scaled its features.'
        + (
            ' It subtracts the mean before the Fourier transform, and so do the texture features '
            'of this comparison. The other sections have the features that they name.'
            if any(result.published for result in results)
            else ''
        )
    )
    page.paragraph(tell_design(results))
    comparisons = compare_with_paper([result.as_published for result in results])
    page.table(
        f'accuracies in %: {results[0].plain.split}',
        ['the paper states', 'agrees when', 'here', ''],
        [[c.statement, c.rule, c.measured, c.verdict] for c in comparisons],
        words=3,
    )


def _add_accuracy(page: Page, results: Sequence[SetResult]) -> None:
    page.heading('Accuracy', folded=True)
    page.drawing(figures_accuracy.draw_accuracies(results))
    for result in results:
        page.subheading(result.recordings.title)
        page.paragraph(describe_features(result.recordings.table.spec))
        for evaluation in result.evaluations:
            _add_scores(page, evaluation)


def _add_scores(page: Page, evaluation: Evaluation) -> None:
    rows = [
        [
            CLASSIFIER_TITLES[score.classifier],
            short_scaling(score.scaling),
            f'{100 * score.mean:.1f}',
            f'± {100 * score.spread:.1f}',
            tell_interval(score.interval),
        ]
        for score in evaluation.scores
    ]
    if (nested := evaluation.nested) is not None:
        folds = sum(count for *_, count in nested.picks)
        picks = ', '.join(
            f'{CLASSIFIER_TITLES[name]}, {short_scaling(scaling)} ({count} of {folds})'
            for name, scaling, count in nested.picks
        )
        interval = tell_interval(nested.interval)
        rows.append(['chosen inside the folds', picks, f'{100 * nested.mean:.1f}', '', interval])
    first = evaluation.scores[0]
    page.table(
        f'accuracy in %: {evaluation.split}; {evaluation.trials} trials; '
        f'chance {100 * evaluation.chance:.1f}; interval: {first.interval.method or "none"}',
        ['classifier', 'features', 'mean', f'spread over {first.spread_of}', '95 % interval'],
        rows,
        words=2,
    )


def _add_figures(
    page: Page, heading: str, drawings: Iterator[Drawing], *, folded: bool = True
) -> None:
    for i, drawing in enumerate(drawings):
        if i == 0:
            page.heading(heading, folded=folded)
        page.drawing(drawing)


def _significance(results: Sequence[SetResult]) -> Iterator[Drawing]:
    for result in results:
        components = find_components(result.recordings.table.spec)
        if result.units:
            yield draw_p_matrices(result)
        elif components is not None:
            yield draw_mean_p(result, components)


def _explain_significance(page: Page, results: Sequence[SetResult]) -> None:
    explained = [
        explain_mean_p(result, components)
        for result in results
        if not result.units
        and (components := find_components(result.recordings.table.spec)) is not None
    ]
    if explained:
        page.paragraph(
            'How many components have a mean p over 0.05 depends on which pairs of classes are '
            'averaged. Where two classes do not differ in a component, p is 0.5 on average, so '
            'that a tenth of the pairs being alike lifts the mean to 0.05, however small p is for '
            'all others. p also falls with the number of trials. The paper gives means '
            'alone, so whether its plates differ more, or its trials scatter less, cannot be told '
            'from it. A high mean p does not say that classes are confused: classifiers see all '
            'components together.'
        )
        page.items(explained)


def _signals(results: Sequence[SetResult]) -> Iterator[Drawing]:
    for result in results:
        recordings = result.recordings
        components = find_components(recordings.table.spec)
        if recordings.examples and components is not None:
            yield figures_signals.draw_textures(result, components)
        if recordings.trial is not None:
            yield figures_signals.draw_trial(result, recordings.trial)
        if recordings.examples and result.units:
            yield figures_signals.draw_holds(result)


def _add_selection(page: Page, results: Sequence[SetResult]) -> None:
    if not any(result.selections for result in results):
        return
    page.heading('Does choosing features help?', folded=True)
    page.paragraph(
        'The paper suggests to keep the components with low mean p. Here ranking and number of '
        'features are chosen on the training trials of each fold alone. It helps or hurts where '
        'the interval of the paired difference leaves zero out.'
    )
    for result in results:
        if result.selections:
            page.subheading(result.recordings.title)
        for split in dict.fromkeys(selection.split for selection in result.selections):
            rows = [_tell_selection(s) for s in result.selections if s.split == split]
            page.table(
                f'accuracy in %: {split}; with all {len(result.recordings.table.spec.names)} '
                'features and with those selected; 95 % interval of the difference in points',
                ['classifier', 'features', 'all', 'selected', 'kept', 'difference', ''],
                rows,
                words=2,
            )


def _tell_selection(selection: SelectionResult) -> list[str]:
    counts = sorted(selection.chosen_counts)
    return [
        CLASSIFIER_TITLES[selection.classifier],
        short_scaling(selection.scaling),
        f'{100 * selection.all_mean:.1f}',
        f'{100 * selection.selected_mean:.1f}',
        f'{counts[0]} to {counts[-1]}' if counts[0] < counts[-1] else f'{counts[0]}',
        'no spread' if selection.difference.reason else tell_interval(selection.difference),
        selection.verdict,
    ]


def _add_provenance(
    page: Page,
    results: Sequence[SetResult],
    sources: Sequence[Source],
    settings: Mapping[str, str],
    versions: Mapping[str, str],
) -> None:
    page.heading('Where this comes from', folded=True)
    rows = []
    for source in sources:
        facts = ', '.join(f'{key} {value}' for key, value in sorted(source.facts.items()))
        rows.append([source.name, source.sha256[:16], facts])
    page.table('recordings', ['name', 'SHA-256 begins with', 'it says'], rows, words=3)
    tables = [(r.recordings.title, r.recordings.table) for r in results]
    rows = [[title, str(len(table)), table.compute_sha256()[:16]] for title, table in tables]
    page.table('feature tables', ['set', 'trials', 'SHA-256 begins with'], rows, words=3)
    page.items(
        [f'{name}: {value}' for name, value in settings.items()]
        + ['versions: ' + ', '.join(f'{name} {version}' for name, version in versions.items())]
        + [
            f'{r.recordings.title}: {line}'
            for r in results
            for line in r.recordings.tell_preparation()
        ]
        + [f'not done: {r.recordings.title}: {line}' for r in results for line in r.not_done]
    )
