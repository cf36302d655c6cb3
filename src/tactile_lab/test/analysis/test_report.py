# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report: its sentences agree with the numbers, and its file is self-contained."""

import dataclasses
import hashlib
import html
import html.parser
import json
import re

import numpy as np
import pytest

from tactile_analysis.datasets.automatic_features import choose_automatically, Chosen
from tactile_analysis.datasets.feature_options import FeatureOptions, select_features
from tactile_analysis.datasets.feature_tables import open_trials
from tactile_analysis.report.analysis import analyse
from tactile_analysis.report.build import build_page, report_path
from tactile_analysis.report.drawings import draw_holds, draw_p_matrices, draw_textures, draw_trial
from tactile_analysis.report.recordings import (
    Example,
    make_sets,
    RecordingSet,
    usual_splits,
)
from tactile_analysis.report.significance import (
    find_components,
    format_least_p,
    format_tested_values,
)
from tactile_analysis.report.summary import (
    describe_sources,
    format_accuracy,
    format_confusion,
    format_first_sentence,
    format_learning_curve,
    format_model,
)
from tactile_analysis.report.svg import INK, render
from tactile_analysis.wording import name_candidate
from tactile_bags.trial import Signal, Trial
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import grouped_split, stratified_split
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.training.feature_choice import ChoicePlan
from tactile_features.config import FeatureConfig
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_features.spec import spec_for
from tactile_features.types import TrialEvent
from tactile_ros.errors import TactileError


def example_of(row, time_s, values):
    return Example(row, Signal(time_s, values[np.newaxis], ('tension_n',)), None)


def make_easy_holds():
    """Return objects that differ only in the slope, although the intercept varies much more."""
    generator = np.random.default_rng(3)
    code = np.repeat([0, 1, 2], 24)
    columns = (
        code + generator.normal(0.0, 0.05, 72),
        generator.normal(0.0, 10.0, 72),
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
    rows = [12, 0]  # one trial of each label
    examples = tuple(example_of(row, time_s, signals[row]) for row in rows)
    return RecordingSet('texture, x.npz', '', False, table, (('day',),), 'raw', examples)


def choose(table, columns=()):
    split = grouped_split(table, columns) if columns else stratified_split(table, 3, 1)
    ((choice,),) = run_plans([ChoicePlan({table.spec.feature_set: table}, split)])
    return Chosen(table, choice, tuple(columns))


def run(recordings, folds=3):
    if recordings.choice is None:
        columns = next(iter(recordings.hold_out), ())
        chosen = choose(recordings.table, columns)
        recordings = dataclasses.replace(recordings, choice=chosen)
    (result,) = analyse([recordings], folds=folds, repetitions=1, random_state=0, jobs=1)
    return result


@pytest.fixture(scope='module')
def easy_holds():
    return run(make_easy_holds())


@pytest.fixture(scope='module')
def textures():
    return run(make_textures())


@pytest.fixture(scope='module')
def page(textures):
    return build_page([textures], [], {'folds': '3'})


class LinkCollector(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.links, self.tags = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        names = ('src', 'href', 'xlink:href', 'data', 'srcset')
        self.links += [value for name, value in attrs if name in names]


def test_page_is_self_contained_escapes_labels_and_names_the_split_of_every_table(page):
    collector = LinkCollector()
    collector.feed(page)
    assert [link for link in collector.links if not link.startswith('#')] == []
    assert not {'script', 'link', 'img', 'iframe', 'b'} & set(collector.tags)
    assert collector.tags.count('svg') == 8
    assert '@import' not in page
    assert 'url(http' not in page
    assert 'fine &lt;b&gt;' in page
    assert 'Early predictions' not in page
    targets = re.findall('<a href="#([^"]+)">', page)
    assert 'accuracy' in targets
    assert all(page.count(f'id="{target}"') == 1 for target in targets)

    captions = [part.split('</caption>')[0] for part in page.split('<caption>')[1:]]
    of_accuracies = [caption for caption in captions if caption.startswith('accurac')]
    assert len(of_accuracies) == 5
    for caption in of_accuracies:
        assert 'stratified 3-fold' in caption or 'one day held out' in caption
    # Intervals over held-out groups cover less than 95 %, because training sets overlap.
    tables = [caption for caption in of_accuracies if 'interval: ' in caption]
    stated = [caption for caption in tables if 'true accuracy in 84 to 95 % of' in caption]
    assert stated == [caption for caption in tables if 'Wilson with t over 3 groups' in caption]
    assert len(stated) == 1
    assert 'SIMULATED' not in page


def test_page_begins_with_sentence_figure_signals_and_tables_and_collapses_the_rest(
    page, textures
):
    whole, *folded = page.split('<details>')
    sentence = format_first_sentence(textures)
    assert ' of the trials of a new day are classified correctly (' in sentence
    assert '<li>Model: texture_spectrum with ' in whole
    order = [sentence, '<svg', '>Signals</h2>', '>Accuracy</h2>', '<table']
    places = [whole.index(text) for text in order]
    assert places == sorted(places)
    assert whole[: places[0]].count('<p') == 1
    assert all(part.count('</details>') == 1 for part in folded)
    # Sections outside <details> are always printed.
    shown = whole + page.split('</details>')[-1]
    assert 'details:not([open]) { display: none; }' in page.split('@media print')[1]
    assert shown.count('<caption>accuracy in %') == 2
    assert textures.recordings.table.compute_sha256()[:16] in shown
    assert 'folds: 3' in shown


def test_each_figure_has_a_text_alternative_with_its_numbers(page, textures):
    labels = re.findall(r'<svg role="img" aria-label="([^"]+)"', page)
    assert len(labels) == page.count('<svg') == 8
    assert all(re.search(r'\d', label) for label in labels)
    accuracy, confusion, signals = labels[:3]
    assert f'{100 * textures.plain.score("knn", "none").mean:.1f} %, stratified' in accuracy
    assert 'coarse 100 %' in confusion
    assert re.search(r'coarse: [\d.]+, 5 Hz', signals)


def test_texts_of_figures_are_legible_on_a_phone(page):
    widths = [float(each) for each in re.findall(r'viewBox="0 0 ([0-9.]+) ', page)]
    assert len(widths) == 8
    # A phone has a width of 390 px with margins. Figures have fonts of 8.5 points, which must not
    # be scaled by less than 0.7.
    assert max(widths) * 96 / 72 <= 350 / 0.7


@pytest.mark.parametrize(
    ('columns', 'mean', 'sentence'),
    [
        (('session_id',), 0.74, '74.0 % of the trials of a new session are'),
        (('session_id',), 0.74, 'are classified correctly (72 trials'),
        (('session_id',), 0.9997, '> 99.9 % of the trials of a new session'),
        (('trial_block',), 1.0, '100.0 % of the trials of another part of the same session'),
        (('trial_block',), 1.0, 'does not predict the accuracy in a new session.'),
        (('day', 'hour'), 0.5, '50.0 % of the trials of a new day and hour'),
        ((), 0.5, '50.0 % of the trials are classified correctly'),
        ((), 0.5, 'does not predict the accuracy in a new session.'),
        ((), 0.5, 'chance 33.3 %)'),
        ((), 0.5, '(72 trials; 95 % interval '),
    ],
)
def test_first_sentence_states_trials_interval_chance_and_held_out_groups(
    easy_holds, columns, mean, sentence
):
    choice = easy_holds.recordings.choice.choice
    choice = dataclasses.replace(choice, nested=dataclasses.replace(choice.nested, mean=mean))
    chosen = dataclasses.replace(easy_holds.recordings.choice, choice=choice, columns=columns)
    recordings = dataclasses.replace(easy_holds.recordings, choice=chosen)
    result = dataclasses.replace(easy_holds, recordings=recordings)
    assert sentence in format_first_sentence(result)


def test_the_headline_is_the_accuracy_of_the_choice_or_of_selected_test_trials(easy_holds):
    nested = easy_holds.recordings.choice.choice.nested
    assert easy_holds.headline is nested
    assert format_accuracy(easy_holds).startswith('accuracy of this selection procedure')
    assert name_candidate(easy_holds.recordings.choice.choice.chosen) in format_model(easy_holds)
    stated = dataclasses.replace(easy_holds.plain, scores=easy_holds.plain.scores[:1])
    result = dataclasses.replace(easy_holds, stated=stated)
    mean = stated.scores[0].mean
    assert format_accuracy(result).startswith(f'accuracy {100 * mean:.1f} % (stratified 3-fold')
    assert ' of the stated test trials are classified correctly (' in format_first_sentence(result)


def test_format_accuracy_counts_trials_without_features_and_states_baselines(easy_holds):
    nested = easy_holds.recordings.choice.choice.nested
    assert easy_holds.end_to_end == nested.mean
    assert 'without features' not in format_accuracy(easy_holds)
    table = dataclasses.replace(easy_holds.recordings.table, refused=8)
    result = dataclasses.replace(
        easy_holds, recordings=dataclasses.replace(easy_holds.recordings, table=table)
    )
    assert result.end_to_end == pytest.approx(nested.mean * 72 / 80)
    line = format_accuracy(result)
    assert f'the 8 trials without features count as wrong: {100 * result.end_to_end:.1f} %' in line
    assert f'balanced accuracy {100 * nested.balanced_accuracy:.1f} %' in line
    permuted = easy_holds.permuted
    assert (permuted.split, permuted.classifier) == (nested.split, nested.classifier)
    assert f'permuted labels: {100 * permuted.mean:.1f} % on average' in line
    stated = result.to_dict()
    assert (stated['refused'], stated['end_to_end']) == (8, result.end_to_end)


def test_learning_curve_and_calibration_are_in_text_tables_and_figures(textures, page):
    curve, reliability = textures.curve, textures.reliability
    assert [point.groups for point in curve.points] == [1, 2]
    said = format_learning_curve(textures)
    assert said.startswith('Learning curve: ')
    assert '1 training group (day)' in said
    assert f'{100 * curve.gain:+.1f} points' in said
    assert said in html.unescape(page)
    assert '<th scope="col">training groups (day)</th>' in page
    assert (reliability.trials, reliability.split) == (24, 'one day held out')
    assert f'Expected calibration error {100 * reliability.error:.1f} % with 24 trials' in page
    stated = textures.to_dict()
    assert stated['learning_curve']['needs_more'] == curve.needs_more
    assert stated['reliability']['error'] == reliability.error


def test_without_groups_the_report_states_why_there_is_no_learning_curve(easy_holds):
    assert easy_holds.curve is None
    assert format_learning_curve(easy_holds) is None
    assert any('learning curve' in each and 'no sessions' in each for each in easy_holds.not_done)
    # The calibration is also evaluated in random folds.
    assert easy_holds.reliability.trials == 72


def test_captions_state_slope_and_intercept_with_their_units(easy_holds):
    time_s = np.arange(60) / 60.0
    rows = (0, 24, 48)
    examples = tuple(example_of(row, time_s, 2.0 - 0.5 * time_s) for row in rows)
    result = dataclasses.replace(
        easy_holds, recordings=dataclasses.replace(easy_holds.recordings, examples=examples)
    )
    assert 'pla -0.5 N/s, 2 N' in draw_holds(result).caption
    phases = (('contact', 0.0, 0.2), ('hold', 0.2, 0.8), ('release', 0.8, 1.0))
    events = tuple(
        TrialEvent(int(1e9 * start_s), '1', 's', 'stiffness', 'flexion', 'pla', phase)
        for phase, start_s, _ in (*phases, ('done', 1.0, 1.0))
    )
    trial = Trial(
        '1', 'bag', 'pla', events=events, begin_ns=0, load_signal=lambda: examples[0].window
    )
    window = {'window_start_ns': np.full(72, 3 * 10**8), 'window_end_ns': np.full(72, 7 * 10**8)}
    table = dataclasses.replace(result.recordings.table, columns=window)
    result = dataclasses.replace(
        result, recordings=dataclasses.replace(result.recordings, table=table)
    )
    slope, intercept, correlation = result.recordings.table.values[0]
    caption = draw_trial(result, 0, trial).caption
    assert f'slope {slope:.3g} N/s, intercept {intercept:.3g} N, ' in caption
    assert f'correlation {correlation:.3g}.' in caption
    assert 'slope [N/s], intercept [N], correlation' in draw_p_matrices(result).caption


def test_simulated_trials_are_marked_in_every_figure_and_table(stiffness_bag):
    with open_trials([stiffness_bag]) as trials:
        chosen = choose_automatically(
            trials, FeatureOptions(), 3, 0, lambda _: None, any_set=False
        )
        sets = make_sets(trials, FeatureOptions(), chosen, report=True)
        sources = describe_sources([stiffness_bag.parent], trials)
    assert sets[0].hold_out == (('trial_block',),)
    result = run(sets[0], folds=3)
    page = build_page([result], sources, {'folds': '3'})
    figures = page.split('<figure>')[1:]
    assert len(figures) == 9
    for figure in figures:
        assert '<figcaption>SIMULATED. ' in figure
        assert 'aria-label="SIMULATED. ' in figure
        assert '>SIMULATED</text>' in figure
    assert re.search('<p class="lead">SIMULATED. .* of another part of the same session', page)
    tables = page.split('<caption>')[1:]
    assert all(table.startswith('SIMULATED. ') for table in tables)
    assert 'seed 7' in page
    json.dumps(result.to_dict(), allow_nan=False)
    # The examples are the windows from which the features were computed.
    found = result.recordings
    assert len(found.examples) == 5
    for example in found.examples:
        slope, intercept, correlation = found.table.values[example.row]
        time_s, values = example.window.time_s, example.window.values[0]
        fit = np.polynomial.Polynomial.fit(time_s, values, 1).convert()
        assert fit.coef == pytest.approx([intercept, slope], rel=1e-6)
        assert np.corrcoef(time_s, values)[0, 1] == pytest.approx(correlation)
        (hold,) = (phase for phase in example.trial.phases if phase[0] == 'hold')
        start_s = 1e-9 * (
            int(found.table.column('window_start_ns')[example.row]) - example.trial.begin_ns
        )
        assert hold[1] < start_s < start_s + time_s[-1] < hold[2]


def test_summary_states_accuracy_chance_and_confusion_in_one_line(textures, easy_holds):
    line = format_accuracy(textures)
    nested = textures.recordings.choice.choice.nested
    assert line.startswith(f'accuracy of this selection procedure: {100 * nested.mean:.1f} % (')
    assert '(one day held out; ' in line
    assert f'chance {100 * textures.plain.chance:.1f} %; balanced accuracy ' in line
    assert '; most frequent confusion: ' in line
    score = easy_holds.plain.score('knn', 'standard')
    confusion = np.array([[70, 2, 0], [0, 48, 24], [9, 0, 63]])
    told = format_confusion(dataclasses.replace(score, confusion=confusion))
    one, other = score.labels[1:]
    assert told == f'{one} as {other} in 33 % of its trials'


def test_page_shows_warnings_and_what_the_trials_do_not_allow(easy_holds):
    tied = dataclasses.replace(easy_holds.plain, warnings=('labels and sessions coincide',))
    result = dataclasses.replace(easy_holds, evaluations=(tied,), not_done=('no session is left',))
    page = build_page([result], [], {})
    for text in (*tied.warnings, *result.not_done):
        assert text in page
    # The report is about the user's trials, also if they have labels of the paper.
    assert 'the paper' not in page


def test_table_with_one_feature_is_evaluated_and_states_omitted_analyses():
    table = select_features(make_easy_holds().table, 'slope')
    result = run(RecordingSet('one', '', False, table, (), 'N'), folds=2)
    assert result.selections == ()
    curve, selection = result.not_done
    assert curve.startswith('learning curve: ')
    assert selection.startswith('feature selection: ')


def test_figures_use_the_text_colour_of_the_page_and_unique_ids():
    def draw(figure):
        figure.subplots().plot([1, 2])

    first, again = (render(draw, (3, 2), 'a', 'up to "2"', simulated=False) for _ in range(2))
    assert first == again
    svg = first.svg
    assert 'currentColor' in svg
    assert INK not in svg
    assert 'id="figure' not in svg
    assert svg.startswith('<svg role="img" aria-label="up to &quot;2&quot;" ')


def test_report_is_written_to_a_file_or_into_a_folder(tmp_path):
    assert report_path(tmp_path / 'a.html') == tmp_path / 'a.html'
    assert report_path(tmp_path / 'new' / 'folder') == tmp_path / 'new' / 'folder' / 'report.html'
    assert list((tmp_path / 'new' / 'folder').iterdir()) == []
    (tmp_path / 'file').write_text('')
    with pytest.raises(TactileError, match='cannot write the report'):
        report_path(tmp_path / 'file' / 'a.html')


@pytest.mark.parametrize(
    ('unit', 'axis', 'size'),
    [
        ('N', 'amplitude [mN]', r'coarse: [\d.]{3} mN, 5 Hz'),
        ('mV', 'amplitude [mV]', r'coarse: 0\.7\d* mV, 5 Hz'),
        ('', 'amplitude (unit unknown)', r'coarse: 0\.7\d*, 5 Hz'),
    ],
)
def test_figures_state_the_unit_of_the_recordings_or_that_it_is_unknown(
    textures, unit, axis, size
):
    recordings = dataclasses.replace(textures.recordings, unit=unit)
    components = find_components(recordings.table.spec)
    drawing = draw_textures(dataclasses.replace(textures, recordings=recordings), components)
    assert f'>{axis}</text>' in drawing.svg
    assert re.search(size, drawing.svg)


def test_components_are_found_by_the_names_of_the_features():
    spec = spec_for('texture', FeatureConfig())
    components = find_components(spec)
    np.testing.assert_allclose(components.frequency, np.arange(1, 91) / 3, atol=1e-3)
    assert components.columns.tolist() == list(range(1, 91))
    over_distance = spec_for('texture', FeatureConfig(texture_features='texture_spatial'))
    found = find_components(over_distance)
    assert found.title == 'spatial frequency [cycles/mm]'
    assert found.frequency[0] == pytest.approx(1 / 45, rel=1e-3)
    assert find_components(spec_for('stiffness', FeatureConfig())) is None


def test_report_states_which_values_the_rank_sum_tests_compare(easy_holds):
    said = format_tested_values(easy_holds)
    assert said.startswith('72 trials as independent samples. The mountings are not stated')
    assert format_least_p(easy_holds) is None
    table = make_easy_holds().table
    session, mounting = np.arange(72) % 2, np.arange(72) % 4
    columns = {'session_id': session.astype(str), 'mounting_id': mounting.astype(str)}
    recordings = dataclasses.replace(
        easy_holds.recordings, table=dataclasses.replace(table, columns=columns)
    )
    result = run(recordings, folds=2)
    assert result.significance.counts == (4, 4, 4)
    said = format_tested_values(result)
    assert said.startswith('means of 12 mountings (4 of each label; 72 trials)')
    assert said.endswith('compared within 2 sessions (van Elteren)')
    # With two mountings of each label in a session, the test cannot find a difference.
    assert result.significance.least_p > 0.05
    page = build_page([result], [], {})
    assert format_least_p(result) in page
    assert 'Every pair of objects differs' not in page
    # The AUC nevertheless shows that the slope separates all trials.
    assert result.to_dict()['rank_sum']['auc'][0][0][1] == 0.0
    json.dumps(result.to_dict(), allow_nan=False)


@pytest.mark.parametrize('missing', ['mounting_id', 'names'])
def test_without_stated_mountings_one_mounting_per_label_and_session_is_assumed(missing):
    recordings = make_easy_holds()
    columns = {'session_id': (np.arange(72) % 6).astype(str)}
    if missing == 'names':
        columns['mounting_id'] = np.where(np.arange(72) < 3, '', 'a')
    table = dataclasses.replace(recordings.table, columns=columns)
    result = run(dataclasses.replace(recordings, table=table), folds=2)
    assert result.significance.counts == (6, 6, 6)
    assert 'one mounting per session' in format_tested_values(result)


def make_grouped(**columns):
    table = make_easy_holds().table
    count = np.arange(len(table))
    made = {name: np.char.mod('%d', count % divisor) for name, divisor in columns.items()}
    return FeatureTable(table.values, table.labels, table.spec, made)


@pytest.mark.parametrize(
    ('columns', 'held_out'),
    [
        ({}, []),
        ({'repetition': 3}, []),
        ({'session': 3}, [('session_id',)]),
        ({'Day': 3}, [('Day',)]),
        ({'session_id': 1, 'trial_block': 4}, [('trial_block',)]),
        ({'session_id': 3, 'mounting': 6}, [('session_id',), ('mounting_id',)]),
        # Each trial has a separate mounting, so random folds hold out mountings.
        ({'mounting_id': 72}, []),
    ],
)
def test_sessions_and_mountings_are_held_out_by_default(columns, held_out):
    found, not_done = usual_splits(make_grouped(**columns))
    assert found == held_out
    assert len(not_done) == (columns.get('session_id') == 1)


def test_report_with_unknown_objects_opens_each_bag_once(stiffness_bag, opened):
    with open_trials([stiffness_bag]) as trials:
        chosen = choose_automatically(
            trials, FeatureOptions(), 2, 0, lambda _: None, any_set=False
        )
        sets = make_sets(trials, FeatureOptions(), chosen, report=True, unknown_objects=True)
        (source,) = describe_sources([stiffness_bag], trials)
    assert len(opened) == 1
    assert sets[0].examples
    assert all(example.trial for example in sets[0].examples)
    (file,) = stiffness_bag.glob('*.mcap')
    assert source.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()
