# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmark that reproduces the paper: its protocol, and its tests of the paper's claims."""

import importlib
from pathlib import Path

import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parents[4]
if not (REPOSITORY / 'benchmarks').is_dir():
    pytest.skip('the packages are not in their own repository', allow_module_level=True)

PATTERN = {'texture': ([1.0, 0.9, 1.0, 0.98], 0.05), 'stiffness': ([0.99, 0.98, 0.7, 0.975], 0.0)}
"""For each task, the accuracies of the four classifiers in the paper, and how many features do not
differ between objects: a fraction of the texture features, or a number of pairs of objects."""


@pytest.fixture(scope='module')
def paper():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(REPOSITORY)
        names = ('protocol', 'statements', 'reproduction', 'figures', 'settings')
        yield {name: importlib.import_module(f'benchmarks.paper.{name}') for name in names}


@pytest.fixture(scope='module')
def holds(paper):
    return paper['protocol'].make_trials('stiffness', 'flexion', 1)


def test_trials_and_features_are_as_in_the_paper(paper, holds):
    assert holds.values.shape == (300, 3)
    labels, counts = np.unique(holds.labels, return_counts=True)
    assert set(labels) == {'pla', 'solid_rubber', 'rubber_shell', 'sponge', 'none'}
    assert set(counts) == {60}
    textures = paper['protocol'].make_trials('texture', 'flexion', 1)
    assert textures.values.shape == (480, 91)
    assert len(set(textures.labels)) == 8
    # The mean was subtracted, so the component at 0 Hz contains only rounding errors.
    assert textures.values[:, 0].max() < 1e-12


def test_other_unit_of_force_scales_only_features_with_a_force(paper, holds):
    in_unit = paper['protocol'].in_unit
    scaled = in_unit('stiffness', holds.values, 1e3)
    np.testing.assert_array_equal(scaled, holds.values * [1e3, 1e3, 1.0])
    np.testing.assert_array_equal(in_unit('texture', holds.values, 1e3), holds.values * 1e3)


def test_every_repetition_has_different_folds(paper, holds):
    found = paper['protocol'].cross_validate(*holds, scaled=True, repetitions=2)
    assert found.shape == (4, 2)
    assert (found > 0.6).all()
    assert (found[:, 0] != found[:, 1]).any()


@pytest.mark.parametrize('task', PATTERN)
def test_numbers_of_the_paper_agree_with_its_statements_and_others_do_not(paper, task):
    accuracies, alike = map(np.array, PATTERN[task])
    found = [each for each in paper['statements'].STATEMENTS if each.task == task]
    assert len(found) == {'texture': 4, 'stiffness': 3}[task]
    for each in found:
        assert each.agrees(accuracies, alike)
        # Equal accuracies of 90 % and many similar features contradict every statement.
        assert not each.agrees(np.full(4, 0.9), np.array(5.0))
        # Results of several seeds are passed as arrays.
        both = each.agrees(np.array([accuracies, np.full(4, 0.9)]), np.array([alike, 5.0]))
        assert both.tolist() == [True, False]


def test_contacts_agree_within_three_points(paper):
    assert paper['statements'].contacts_agree((0.99, 0.97))
    assert not paper['statements'].contacts_agree((0.99, 0.95))


def test_unscaled_rbf_svm_uses_only_the_intercept(paper):
    """Objects differ only in the slope of the fitted line, but its intercept varies much more."""
    generator = np.random.default_rng(3)
    code = np.repeat([0, 1, 2], 24)
    columns = (
        code + generator.normal(0.0, 0.05, 72),
        generator.normal(0.0, 10.0, 72),
        np.clip(generator.normal(-0.9, 0.01, 72), -1.0, 0.0),
    )
    trials = paper['protocol'].Trials(
        np.stack(columns, axis=1), np.array(['pla', 'rubber_shell', 'sponge'])[code]
    )
    shares, accuracies = paper['reproduction'].find_scaling_cause(trials)
    assert shares[1] > 0.95
    assert sum(shares) == pytest.approx(1.0)
    assert min(accuracies.values()) < 0.6
    scaled = paper['protocol'].cross_validate(*trials, scaled=True, repetitions=1)
    assert scaled[paper['reproduction'].RBF, 0] > 0.97


def test_tables_and_figures_show_every_set_beside_the_paper_marked_as_simulated(paper):
    """The test uses few trials, because the complete reproduction takes minutes."""
    few = {}
    reproduction, statements = paper['reproduction'], paper['statements']
    for task in paper['protocol'].TASKS:
        for contact in paper['protocol'].CONTACTS:
            trials = paper['protocol'].make_trials(task, contact, 1)
            kept = np.arange(len(trials.labels)) % 60 < 12
            trials = paper['protocol'].Trials(trials.values[kept], trials.labels[kept])
            accuracies = {
                name: paper['protocol'].cross_validate(*trials, scaled=scaled, repetitions=1)
                for name, scaled in reproduction.SCALINGS.items()
            }
            alike = statements.measure_alike(task, trials)
            few[task, contact] = reproduction.Result(trials, accuracies, alike)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduction, 'reproduce', lambda repetitions: few)
        report = reproduction.run_paper(quick=True)
    assert [len(each.rows) for each in (report, *report.more)] == [20, 9, 7, 2]
    assert all('SIMULATED' in each.title for each in (report, *report.more))
    first = report.rows[0].more
    assert first['published'] == '100.0'
    figure = paper['figures'].draw_figures(few)
    assert 'SIMULATED' in figure._suptitle.get_text()
    assert len([axes for part in figure.subfigs for axes in part.axes]) == 12
