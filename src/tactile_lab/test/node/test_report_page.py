# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The HTML report, displayed by Chromium at the width of a phone and as a printed page."""

from chromium import Chromium, find_chromium
import numpy as np
import pytest

from tactile_analysis.datasets.automatic_features import Chosen
from tactile_analysis.report.analysis import analyse
from tactile_analysis.report.build import build_page
from tactile_analysis.report.recordings import RecordingSet
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import grouped_split
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.training.feature_choice import ChoicePlan
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for

pytestmark = pytest.mark.skipif(
    find_chromium() is None, reason='no Chromium is installed; apt install chromium'
)


@pytest.fixture(scope='module')
def browser(tmp_path_factory):
    generator = np.random.default_rng(5)
    code = np.repeat(np.arange(8), 6)
    labels = np.array([f'rubber_shell_{i}' for i in code])
    values = code[:, np.newaxis] + generator.normal(0.0, 1.0, (48, 3))
    columns = {'session_id': np.arange(48) % 3}
    table = FeatureTable(values, labels, spec_for('stiffness', FeatureConfig()), columns)
    split = grouped_split(table, ['session_id'])
    ((choice,),) = run_plans([ChoicePlan({table.spec.feature_set: table}, split)])
    chosen = Chosen(table, choice, ('session_id',))
    recordings = RecordingSet('stiffness', '', True, table, (('session_id',),), 'N', choice=chosen)
    results = analyse([recordings], folds=2, repetitions=1, random_state=0, jobs=1)
    file = tmp_path_factory.mktemp('report') / 'report.html'
    file.write_text(build_page(results, [], {'folds': '2'}), encoding='utf-8')
    with Chromium() as browser:
        browser.open(file.as_uri())
        assert browser.console == []
        yield browser


def heights(browser, selector):
    """Return the heights [px] of the elements that a CSS selector selects."""
    return browser.evaluate(
        f'[...document.querySelectorAll({selector!r})].map(e => e.getBoundingClientRect().height)'
    )


@pytest.mark.parametrize('width', [390, 1280])
def test_page_is_not_truncated_and_does_not_scroll_sideways(browser, width):
    browser.resize(width, 844)
    browser.evaluate('document.querySelectorAll("details").forEach(e => { e.open = true; })')
    try:
        assert browser.evaluate('document.documentElement.scrollWidth') == width
        # No figure, table or cell is wider than the page or its row.
        beyond = browser.evaluate(
            '[...document.querySelectorAll("svg, table, th, td, caption, p, li")]'
            '.filter(e => e.checkVisibility())'
            '.filter(e => e.getBoundingClientRect().right > innerWidth'
            ' || e.scrollWidth > e.clientWidth + 1 && e.tagName != "svg")'
            '.map(e => e.outerHTML.slice(0, 200))'
        )
        assert beyond == []
    finally:
        browser.evaluate('document.querySelectorAll("details").forEach(e => { e.open = false; })')
        browser.resize(1280, 900)


def test_a_phone_shows_wide_tables_with_one_cell_per_line_and_its_column(browser):
    browser.resize(390, 844)
    browser.evaluate('document.querySelectorAll("details").forEach(e => { e.open = true; })')
    try:
        told = browser.evaluate(
            '[...document.querySelector(".many tbody tr").children]'
            '.map(e => [e.dataset.column, getComputedStyle(e).display])'
        )
        assert [column for column, _ in told][:2] == ['classifier', 'features']
        assert {display for _, display in told} == {'flex'}
    finally:
        browser.evaluate('document.querySelectorAll("details").forEach(e => { e.open = false; })')
        browser.resize(1280, 900)


def test_printed_page_has_accuracy_tables_versions_and_open_sections(browser):
    browser.call('Emulation.setEmulatedMedia', media='print')
    try:
        captions = browser.evaluate(
            "[...document.querySelectorAll('caption')].filter(e => e.checkVisibility())"
            '.map(e => e.textContent)'
        )
        shown = [caption.split(':')[0].removeprefix('SIMULATED. ') for caption in captions]
        assert shown == ['accuracy in %', 'accuracy in %', 'recordings', 'feature tables']
        assert set(heights(browser, 'details')) == {0}
        browser.evaluate('document.querySelector("details").open = true')
        assert max(heights(browser, 'details')) > 100
    finally:
        browser.call('Emulation.setEmulatedMedia', media='')
