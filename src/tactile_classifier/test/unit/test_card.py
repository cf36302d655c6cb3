# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The card of a model file: what it says."""

import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import stratified_split
from tactile_classifier.evaluation.cross_validation import evaluate
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.model_file.manifest import format_card, list_facts, list_limits
from tactile_classifier.model_file.model import read_model_card
from tactile_classifier.records import CLASSIFIER_TITLES
from tactile_classifier.training.feature_choice import ChoicePlan
from tactile_classifier.training.model_writer import write_model, write_recalibrated
from tactile_classifier.training.trainer import describe_training, train
from tactile_features.onnx_container import MAX_CARD_BYTES

NO_SESSION = 'No session was held out: a new session may do worse.'


def with_columns(table, **columns):
    filled = {name: np.resize(np.asarray(values), len(table)) for name, values in columns.items()}
    return FeatureTable(table.values, table.labels, table.spec, filled)


def test_file_holds_the_card_of_its_manifest(small_table, tmp_path):
    model = write_model(tmp_path / 'm.onnx', train(small_table, 'knn'))
    card = read_model_card(tmp_path / 'm.onnx')
    assert card == format_card(model.manifest)
    assert '- answers: texture, flexion: plate 0, plate 1, plate 2\n' in card
    assert 'SIMULATED trials say nothing of a real finger.' in card


def test_card_says_what_was_chosen_and_what_unlearned_labels_do(texture_table):
    table = texture_table.take(np.arange(480) % 4 == 0)
    split = stratified_split(table, 2, 1)
    plan = ChoicePlan({'texture_spectrum': table}, split, scaling='standard')
    (choice,) = run_plans([plan])
    chosen = choice.best.candidate
    score = evaluate(table, [chosen.classifier], [chosen.scaling], repetitions=1).scores[0]
    manifest = train(table, chosen.classifier, chosen.scaling, score=score, choice=choice).manifest
    facts = list_facts(manifest)
    runner_up = choice.find_runner_up(chosen)
    assert facts['chosen'].startswith(
        'from 4 sets of features with classifiers; such a choice names '
        f'{100 * choice.nested_accuracy:.1f} % correctly (stratified 2-fold, once); '
        f'runner-up: texture_spectrum, {CLASSIFIER_TITLES[runner_up.candidate.classifier]}, '
    )
    assert facts['unlearned labels'] == (
        f'{100 * manifest.calibration["unlearned"]["miss_rate"]:.0f} % of their trials get a '
        'known name: each of 8 labels left out in turn'
    )
    stated = list_facts(train(table, 'knn').manifest)
    assert stated['chosen'] == 'features and classifier as stated, not by the folds'


def test_conditions_come_from_the_training_trials(small_table):
    found = describe_training(
        with_columns(
            small_table,
            session_id=['a', 'b', 'c'],
            mounting_id=['m'],
            glide_speed_m_s=[0.02, 0.04],
            simulated=[True, False],
        )
    )
    assert (found.sessions, found.mountings, found.simulated) == (3, 1, 18)
    assert (found.speeds, found.slowest_m_s, found.fastest_m_s) == (2, 0.02, 0.04)
    none = describe_training(with_columns(small_table, session_id=['']))
    assert (none.sessions, none.mountings, none.speeds, none.simulated) == (0, 0, 0, 0)
    # Archives of others may say "session".
    assert describe_training(with_columns(small_table, session=[1, 2])).sessions == 2


def test_a_column_session_is_held_out_for_calibration(small_table):
    day = np.arange(len(small_table)) % 3
    columns = {'session': day}
    table = FeatureTable(small_table.values, small_table.labels, small_table.spec, columns)
    limits = list_limits(train(table, 'knn', false_alarm_rate=0.1).manifest)
    assert any(limit.startswith('3 sessions were held out in turn.') for limit in limits)
    assert not any('No session was held out' in limit for limit in limits)


def test_why_no_session_was_held_out_is_the_true_reason(small_table):
    # Sessions could be held out, but too few trials are left for a threshold at this rate.
    manifest = train(small_table, 'knn', false_alarm_rate=0.001).manifest
    (limit,) = (limit for limit in list_limits(manifest) if 'No session was held out' in limit)
    assert manifest.calibration['reason'] in limit
    assert 'one session only' not in limit


def test_sessions_are_counted_where_none_can_be_held_out(small_table):
    # Each label in a session of its own: calibration divides trials, not sessions.
    tied = with_columns(small_table, session_id=small_table.labels)
    manifest = train(tied, 'knn').manifest
    assert manifest.calibration['groups'] == 0
    assert '3 sessions' in list_facts(manifest)['trained on']
    assert any('a label occurs in one session only' in limit for limit in list_limits(manifest))


def test_limits_follow_the_conditions(small_table):
    one = with_columns(small_table, session_id=['a'], mounting_id=['m'], glide_speed_m_s=[0.02])
    limits = list_limits(train(one, 'knn').manifest)
    assert NO_SESSION in limits
    assert 'All trials are of one mounting: another mounting was not tested.' in limits
    assert any('at 20 mm/s: another sliding speed was not tested' in limit for limit in limits)
    assert not any('SIMULATED' in limit for limit in limits)
    several = with_columns(
        small_table,
        session_id=np.arange(36) // 3 % 3,
        mounting_id=np.arange(36) // 3 % 3,
        glide_speed_m_s=[0.02, 0.03],
    )
    limits = list_limits(train(several, 'knn').manifest)
    assert '3 sessions were held out in turn.' in limits[0]
    assert not any('mounting' in limit or 'speed' in limit for limit in limits)


def test_recalibrated_file_has_a_card_of_its_own(small_table, tmp_path):
    source = tmp_path / 'm.onnx'
    write_model(source, train(with_columns(small_table, session_id=np.arange(36) % 3), 'knn'))
    known = small_table.take(np.arange(0, 36, 6))
    model = write_recalibrated(tmp_path / 'r.onnx', source, {0: known})
    card = read_model_card(tmp_path / 'r.onnx')
    assert card == format_card(model.manifest)
    assert 'recalibrated: for one session, with 6 known trials; from model texture' in card
    assert 'was shifted by the known trials of one session' in card
    assert '% of new sessions' not in card


def test_card_of_many_long_and_strange_labels_stays_short_plain_text(small_table, tmp_path):
    labels = [f'{i:03d}\x1b[2J\u202e{"x" * 900}' for i in range(18)]
    table = FeatureTable(small_table.values, np.resize(labels, 36), small_table.spec)
    write_model(tmp_path / 'm.onnx', train(table, 'tree'))
    card = read_model_card(tmp_path / 'm.onnx')
    assert card.replace('\n', '').isprintable()
    assert len(card.encode()) < MAX_CARD_BYTES / 4
