# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report: what it says must follow from the numbers, and it must stand alone."""

import dataclasses
import html.parser
import json
import re

import numpy as np
import pytest

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_features.config import FeatureConfig
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_features.spec import spec_for
from tactile_lab.datasets.bag_tables import read_tables
from tactile_lab.datasets.feature_options import select_features
from tactile_lab.report.analysis import analyse, in_unit
from tactile_lab.report.build import build_page, report_path, write_report
from tactile_lab.report.components import find_components
from tactile_lab.report.figures.drawing import INK, render
from tactile_lab.report.page import Page
from tactile_lab.report.published import compare_with_paper, tell_design
from tactile_lab.report.recordings import array_examples, bag_sets, RecordingSet
from tactile_lab.report.summary import hardest_evaluation, tell_accuracy, tell_confusion
from tactile_ros.errors import TactileError


def make_easy_holds():
    """Objects that differ in slope alone, while the intercept varies far more."""
    generator = np.random.default_rng(3)
    code = np.repeat([0, 1, 2], 24)
    columns = (
        code + generator.normal(0.0, 0.05, 72),
        generator.normal(0.0, 30.0, 72),
        np.clip(generator.normal(-0.9, 0.01, 72), -1.0, 0.0),
    )
    labels = np.array(['pla', 'rubber_shell', 'sponge'])[code]
    table = FeatureTable(np.stack(columns, axis=1), labels, spec_for('stiffness', FeatureConfig()))
    return RecordingSet('stiffness, flexion', 'flexion', False, table, (), 'N')


def make_textures():
    generator = np.random.default_rng(4)
    time_s = np.arange(180) / 60.0
    labels = np.repeat(['fine <b>', 'coarse'], 12)
    frequency_hz = np.where(labels == 'coarse', 5.0, 20.0)
    signals = np.sin(2 * np.pi * frequency_hz[:, None] * time_s) + generator.normal(
        0.0, 0.1, (24, 180)
    )
    spec = spec_for('texture', FeatureConfig())
    table = FeatureTable(compute_spectrum(signals), labels, spec, {'day': np.arange(24) % 3})
    examples = array_examples(table, signals, 60.0)
    return RecordingSet('texture, x.npz', '', False, table, (('day',),), 'raw', examples)


def run(recordings, folds=6):
    (result,) = analyse([recordings], folds=folds, repetitions=1, random_state=0, jobs=1)
    return result


def with_table(result, **changes):
    """Return a result as if its table had other labels or columns."""
    table = dataclasses.replace(result.recordings.table, **changes)
    recordings = dataclasses.replace(result.recordings, table=table)
    return dataclasses.replace(result, recordings=recordings)


@pytest.fixture(scope='module')
def easy_holds():
    return run(make_easy_holds())


@pytest.fixture(scope='module')
def textures():
    return run(make_textures())


@pytest.fixture(scope='module')
def page(textures):
    return build_page([textures], [], {'folds': '6'}, {'python': '3'})


class LinkCollector(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.links, self.tags = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        names = ('src', 'href', 'xlink:href', 'data', 'srcset')
        self.links += [value for name, value in attrs if name in names]


def test_page_stands_alone_escapes_labels_and_names_the_split_of_every_table(page):
    collector = LinkCollector()
    collector.feed(page)
    assert [link for link in collector.links if not link.startswith('#')] == []
    assert not {'script', 'link', 'img', 'iframe', 'b'} & set(collector.tags)
    assert collector.tags.count('svg') == 5
    assert '@import' not in page
    assert 'url(http' not in page
    assert 'fine &lt;b&gt;' in page
    assert 'Early predictions' not in page
    for target in (link[1:] for link in collector.links if link.startswith('#s')):
        assert f'id="{target}"' in page

    captions = [part.split('</caption>')[0] for part in page.split('<caption>')[1:]]
    of_accuracies = [caption for caption in captions if caption.startswith('accurac')]
    assert len(of_accuracies) == 4
    for caption in of_accuracies:
        assert 'stratified 6-fold' in caption or 'one day held out' in caption
    assert 'SIMULATED' not in page


def test_all_but_picture_summary_and_signals_is_folded(page):
    whole, *folded = page.split('<details>')
    assert '<table' not in whole
    assert whole.count('<figure>') == 2
    assert whole.index('<figure>') < whole.index('accuracy ')
    assert all(part.count('</details>') == 1 for part in folded)
    assert page.count('<h2') == 2


def test_simulated_trials_are_marked_in_every_figure_and_table(stiffness_bag, tmp_path):
    sets = bag_sets(read_tables([stiffness_bag]).tables)
    assert sets[0].hold_out == (('trial_block',),)
    result = run(sets[0], folds=3)
    path = tmp_path / 'report.html'
    write_report(path, [result], [stiffness_bag.parent], {'folds': '3'})
    page = path.read_text(encoding='utf-8')
    figures = page.split('<figure>')[1:]
    assert len(figures) == 7
    for figure in figures:
        assert figure.startswith('<figcaption>SIMULATED. ')
        assert '>SIMULATED</text>' in figure
    tables = page.split('<caption>')[1:]
    assert all(table.startswith('SIMULATED. ') for table in tables)
    assert 'slope -0.90, intercept 12.62, correlation -0.99' in page
    assert 'seed 7' in page
    json.dumps(result.to_dict(), allow_nan=False)
    # The examples are the very windows of the features.
    found = result.recordings
    assert len(found.examples) == 5
    for example in found.examples:
        slope, intercept, correlation = found.table.values[example.row]
        fit = np.polynomial.Polynomial.fit(example.time_s, example.signal, 1).convert()
        assert fit.coef == pytest.approx([intercept, slope], rel=1e-6)
        assert np.corrcoef(example.time_s, example.signal)[0, 1] == pytest.approx(correlation)
    start_s, end_s = found.trial.window_s
    (hold,) = (phase for phase in found.trial.trace.phases if phase[0] == 'hold')
    assert hold[1] < start_s < end_s < hold[2]


def test_unscaled_rbf_machine_is_told_from_the_others_and_its_cause_is_seen(easy_holds):
    rows = {c.statement: c for c in compare_with_paper([easy_holds])}
    scaled = rows['Stiffness: neighbours, the linear SVM and the tree reach above 97.2 % (scaled)']
    assert scaled.verdict == 'agrees'
    assert rows['Stiffness: the RBF SVM is dramatically lower (scaled)'].verdict == (
        'does not agree'
    )
    assert rows['Texture: flexion and abduction do equally well'].verdict == 'not tested'
    # In a unit in which slope and correlation count as much as the intercept: all is well.
    assert min(easy_holds.units.values()) < 0.6
    assert easy_holds.plain.score('svm_rbf', 'standard').mean > 0.97
    assert easy_holds.plain.score('svm_rbf', 'none').mean < 0.6


@pytest.mark.parametrize(
    ('mountings', 'sessions', 'words'),
    [
        (lambda label, i: label, lambda i: 'a', '1 session, each .* fixed once, as in'),
        (lambda label, i: f'{label}{i % 2}', lambda i: 'a', 'fixed up to 2 times, not as in'),
        (lambda label, i: label, lambda i: f's{i % 3}', '3 sessions, .* fixed once, not as in'),
        (lambda label, i: '', lambda i: 'a', 'mountings not stated'),
    ],
)
def test_design_of_the_trials_is_told_beside_the_papers(easy_holds, mountings, sessions, words):
    labels = easy_holds.recordings.table.labels
    columns = {
        'mounting_id': np.array([mountings(label, i) for i, label in enumerate(labels)]),
        'session_id': np.array([sessions(i) for i in range(len(labels))]),
    }
    assert re.search(words, tell_design([with_table(easy_holds, columns=columns)]))


def test_summary_states_the_hardest_split_in_one_line(textures, easy_holds):
    line = tell_accuracy(textures)
    held_out = textures.evaluations[1].score('knn', 'none')
    assert held_out.mean <= textures.plain.score('knn', 'none').mean
    assert hardest_evaluation(textures).score('knn', 'none').mean == held_out.mean
    assert line.startswith(f'accuracy {100 * held_out.mean:.1f} % (one day held out; ')
    assert f'chance {100 * textures.plain.chance:.1f} %; most frequent confusion: ' in line
    assert 'the only split' in tell_accuracy(easy_holds)
    score = easy_holds.plain.score('knn', 'standard')
    confusion = np.array([[70, 2, 0], [0, 48, 24], [9, 0, 63]])
    told = tell_confusion(dataclasses.replace(score, confusion=confusion))
    one, other = score.labels[1:]
    assert told == f'{one} as {other} in 33 % of its trials'


def test_papers_statements_stand_beside_the_papers_labels_alone(easy_holds):
    assert 'Beside the paper' not in build_page([easy_holds], [], {}, {})
    names = np.array(['none', 'pla', 'rubber_shell', 'solid_rubber', 'sponge'])
    labels = names[np.arange(len(easy_holds.recordings.table)) % 5]
    assert 'Beside the paper' in build_page([with_table(easy_holds, labels=labels)], [], {}, {})


def test_units_change_forces_and_nothing_else():
    table = make_easy_holds().table
    other = in_unit(table, 1e3)
    np.testing.assert_array_equal(other.values, table.values * [1e3, 1e3, 1.0])


def test_one_feature_is_evaluated_and_says_what_cannot_be_done():
    table = select_features(make_easy_holds().table, 'slope')
    result = run(RecordingSet('one', '', False, table, (), 'N'), folds=2)
    assert result.selections == ()
    assert result.not_done == ('feature selection: there is one feature only',)
    assert 'one feature only' in build_page([result], [], {}, {})


def test_figures_take_the_colour_of_the_page_and_have_no_names_twice():
    drawings = [
        render(lambda figure: figure.subplots().plot([1, 2]), (3, 2), 'a line', simulated=False)
        for _ in range(2)
    ]
    assert drawings[0] == drawings[1]
    svg = drawings[0].svg
    assert 'currentColor' in svg
    assert INK not in svg
    assert 'id="figure' not in svg
    assert svg.startswith('<svg ')


def test_report_goes_to_a_file_or_into_a_folder(tmp_path):
    assert report_path(tmp_path / 'a.html') == tmp_path / 'a.html'
    assert report_path(tmp_path / 'new' / 'folder') == tmp_path / 'new' / 'folder' / 'report.html'
    assert list((tmp_path / 'new' / 'folder').iterdir()) == []
    (tmp_path / 'file').write_text('')
    with pytest.raises(TactileError, match='cannot write the report'):
        report_path(tmp_path / 'file' / 'a.html')


def test_page_escapes_whatever_it_is_given():
    page = Page('<title>', simulated=False)
    page.heading('<i>')
    page.paragraph('a & b')
    page.table('<caption>', ['<'], [['>']])
    text = page.to_html()
    assert '<i>' not in text
    assert '&lt;title&gt;' in text
    assert 'a &amp; b' in text


def test_components_are_known_by_the_names_of_the_features():
    spec = spec_for('texture', FeatureConfig())
    components = find_components(spec)
    np.testing.assert_allclose(components.frequency, np.arange(1, 91) / 3, atol=1e-3)
    assert components.columns.tolist() == list(range(1, 91))
    over_distance = spec_for('texture', FeatureConfig(texture_features='texture_spatial'))
    found = find_components(over_distance)
    assert found.title == 'spatial frequency [cycles/mm]'
    assert found.frequency[0] == pytest.approx(1 / 45, rel=1e-3)
    assert find_components(spec_for('stiffness', FeatureConfig())) is None
