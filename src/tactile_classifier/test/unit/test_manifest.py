# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the manifest of a model file, and of the model card."""

import contextlib
import dataclasses
import json
import math
import re

from classifier_tables import make_table
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_classifier.confidence.held_out_novelty import HeldOutNovelty
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.manifest import (
    Confidence,
    format_card,
    list_facts,
    list_limits,
    Manifest,
    TrainingTrials,
)
from tactile_classifier.model_file.model import load_model
from tactile_classifier.model_file.storage import MAX_CARD_BYTES
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import describe_training, train
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for

GOOD = Manifest(
    task='stiffness',
    contact='abduction',
    spec=spec_for('stiffness', FeatureConfig()),
    labels=('pla', 'sponge'),
    score_kind='margin',
    classifier='svm_rbf',
    scaling='standard',
    simulated=True,
    training_sha256='ab' * 32,
    trials=120,
    trial_digests=('ab' * 8,) * 120,
    versions={'numpy': '2.2.6'},
    cross_validation={
        'mean': 0.9,
        'spread': 0.01,
        'spread_of': 'folds',
        'split': 'random',
        'interval': {'low': 0.8, 'high': 0.95},
    },
    created='2026-01-02T03:04:05+00:00',
    confidence=Confidence(1.5, 2.0, 0.0, 0.1, 0.05, 0.9),
    calibration={
        'split': 'one session held out',
        'groups': 3,
        'strict': True,
        'held_out_novelty': {'names': ['mon', 'tue', 'wed'], 'sessions': [[0.5, 1.5]] * 3},
    },
)


CONFIDENCE = dataclasses.asdict(Confidence())
TRAINING = dataclasses.asdict(TrainingTrials(2, 1, 1, 0.02, 0.02, 120))


def test_round_trip():
    assert Manifest.from_dict(GOOD.to_dict()) == GOOD
    assert Manifest.from_dict(changed()) == GOOD


def changed(**changes):
    return json.loads(json.dumps({**GOOD.to_dict(), **changes}))


@pytest.mark.parametrize(
    ('changes', 'named'),
    [
        ({'format_version': 5}, 'version 5.* train'),
        ({'specification_digest': 'ab' * 8}, 'specification'),
        ({'specification_digest': 7}, '"specification_digest"'),
        ({'format_version': 8}, 'version 8'),
        ({'format_version': None}, 'None'),
        ({'labels': 'pla'}, '"labels"'),
        ({'labels': ['pla', 3]}, '"labels"'),
        ({'labels': ['pla']}, 'names'),
        ({'labels': ['pla', 'pla']}, 'names'),
        ({'labels': ['pla', 'unknown']}, 'reserved'),
        ({'labels': ['no answer', 'pla']}, 'reserved'),
        ({'simulated': 1}, '"simulated"'),
        ({'trials': None}, '"trials"'),
        ({'task': 'texture'}, '"texture"'),
        ({'contact': 'palm'}, 'contact is "palm"'),
        ({'score_kind': 'odds'}, 'score_kind is "odds".* votes'),
        ({'classifier': 'forest'}, 'classifier is "forest"'),
        ({'scaling': 'minmax'}, 'scaling is "minmax"'),
        ({'spec': {}}, 'manifest'),
        ({'training': {}}, '"training"'),
        ({'training': {**TRAINING, 'sessions': 1.5}}, '"sessions"'),
        ({'training': {**TRAINING, 'fastest_m_s': math.inf}}, '"fastest_m_s"'),
        ({'surprise': 1}, '"surprise"'),
        ({'false_alarm_rate': 2.0}, '0 and 1'),
        ({'confidence': 3}, '"confidence"'),
        ({'confidence': {**CONFIDENCE, 'novelty_threshold': math.inf}}, '"novelty_threshold"'),
        ({'confidence': {**CONFIDENCE, 'novelty_threshold': math.nan}}, '"novelty_threshold"'),
        ({'confidence': {**CONFIDENCE, 'more': 1}}, '"confidence"'),
    ],
)
def test_tampered_manifest_is_refused(changes, named):
    with pytest.raises(ModelFileError, match=named):
        Manifest.from_dict(changed(**changes))


def test_missing_entry_is_named():
    for field in GOOD.to_dict().keys() - {'format_version'}:
        content = GOOD.to_dict()
        del content[field]
        with pytest.raises(ModelFileError, match=f'"{field}"'):
            Manifest.from_dict(content)


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([10**400, -(10**400)])
    | st.floats()
    | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)


def check_card(**changes):
    with contextlib.suppress(ModelFileError):
        card = format_card(Manifest.from_dict(changed(**changes)))
        assert card.replace('\n', '').isprintable()
        assert len(card.encode()) < MAX_CARD_BYTES


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted(GOOD.to_dict())), JSON)
def test_any_entry_may_hold_anything(field, value):
    check_card(**{field: value})


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(['cross_validation', 'calibration']),
    st.sampled_from(
        ['mean', 'split', 'groups', 'strict', 'reason', 'choice',
         'unlearned', 'spread', 'held_out', 'held_out_novelty', 'surplus', 'interval']
    ),
    JSON,
)  # fmt: skip
def test_any_entry_of_an_entry_may_hold_anything(where, name, value):
    check_card(**{where: {**getattr(GOOD, where), name: value}})


def test_no_entry_of_the_specification_may_be_a_number_without_end():
    for entry in GOOD.spec.to_dict():
        with pytest.raises(ModelFileError):
            Manifest.from_dict(changed(spec={**GOOD.spec.to_dict(), entry: 10**400}))


# -- the card -----------------------------------------------------------------------


ONE = TrainingTrials(1, 1, 1, 0.02, 0.02, 0)
SEVERAL = TrainingTrials(3, 3, 2, 0.02, 0.03, 0)


@pytest.mark.parametrize(
    ('changes', 'present', 'absent'),
    [
        (
            {'simulated': True},
            ['SIMULATED trials do not predict the accuracy with a real finger.'],
            [],
        ),
        (
            {'training': ONE, 'calibration': {}},
            [
                '1 session, 1 mounting, 20 mm/s',
                'No sessions were held out. Accuracy may be lower in new sessions.',
                'All trials have the same mounting: other mountings were not tested.',
                'at 20 mm/s: other sliding speeds were not tested.',
            ],
            ['SIMULATED'],
        ),
        (
            {'training': SEVERAL},
            [
                '3 sessions, 3 mountings, 2 sliding speeds from 20 to 30 mm/s',
                'Each of 3 sessions was held out once. The threshold for unknown objects holds in',
            ],
            ['other mountings', 'speeds were not tested'],
        ),
        (
            {
                'training': TrainingTrials(0, 0, 1, 0.02, 0.02, 0),
                'calibration': {**GOOD.calibration, 'held_out': ['day']},
            },
            ['3 groups by day, no mounting recorded, 20 mm/s', 'Each of 3 groups by day was held'],
            ['no session recorded'],
        ),
        (
            {'calibration': {**GOOD.calibration, 'strict': False}},
            [
                'The threshold for unknown objects holds on average over new sessions like these',
            ],
            [],
        ),
        (
            {'training': SEVERAL, 'calibration': {'split': 'trials', 'groups': 0}},
            ['a label occurs in only one of them'],
            [],
        ),
        (
            {'cross_validation': {**GOOD.cross_validation, 'spread_of': 'groups'}},
            ['95 % interval 80.0 to 95.0 %; such intervals contained the true accuracy in 84 to'],
            [],
        ),
        # The reason is the number of trials, not the number of sessions.
        (
            {'training': SEVERAL, 'calibration': {'reason': '12 trials cannot'}},
            ['No sessions were held out: 12 trials cannot. Accuracy'],
            ['only one of them'],
        ),
        (
            {'confidence': Confidence(), 'score_kind': 'votes'},
            [
                'raw (votes), not calibrated',
                'Without a threshold for "unknown", every object receives a known label.',
            ],
            ['An unknown object that feels'],
        ),
    ],
)
def test_the_card_says_what_was_and_was_not_tested(changes, present, absent):
    fields = {'task': 'texture', 'simulated': False, **changes}
    fields['calibration'] = {
        **fields.get('calibration', GOOD.calibration),
        'held_out_novelty': GOOD.calibration['held_out_novelty'],
    }
    card = format_card(dataclasses.replace(GOOD, **fields))
    assert [text for text in present if text not in card] == []
    assert [text for text in absent if text in card] == []


def test_conditions_come_from_the_training_trials():
    labels = ['a', 'b'] * 6
    found = describe_training(
        make_table(
            labels,
            session_id=['a', 'b', 'c'] * 4,
            mounting_id=['m'] * 12,
            glide_speed_m_s=[0.02, 0.04] * 6,
            simulated=[True, False] * 6,
        )
    )
    assert found == TrainingTrials(3, 1, 2, 0.02, 0.04, 6)
    assert describe_training(make_table(labels, session_id=[''] * 12)) == TrainingTrials()
    # Archives from other projects may have a column "session" instead of "session_id".
    assert describe_training(make_table(labels, session=[1, 2] * 6)).sessions == 2


def test_the_card_says_that_nothing_was_chosen():
    facts = list_facts(GOOD)
    assert facts['chosen'] == 'features and classifier as given, not chosen automatically'


@pytest.mark.parametrize(
    ('groups', 'half_width', 'warning'),
    [
        (4, 0.02, '4 sessions are too few to assess the probabilities'),
        (6, 0.22, r'6 sessions are too few .* wrong by -16 to \+28 points'),
        (6, 0.05, None),
        (0, None, 'several held-out sessions are needed to assess the prob'),
    ],
)
def test_the_card_warns_where_groups_are_too_few_for_probabilities(groups, half_width, warning):
    calibration = {'split': 'one session held out', 'groups': groups, 'strict': False}
    if half_width is not None:
        calibration['surplus'] = {'mean': 0.06, 'half_width': half_width}
    manifest = dataclasses.replace(GOOD, score_kind='probability', calibration=calibration)
    limits = ' '.join(list_limits(manifest))
    assert (re.search(warning, limits) is not None) if warning else ('WARNING' not in limits)
    raw = dataclasses.replace(manifest, score_kind='margin')
    assert 'WARNING' not in ' '.join(list_limits(raw))


def test_the_card_states_both_thresholds_by_session_with_the_worst_one():
    known = HeldOutNovelty(
        tuple(np.arange(20.0) + shift for shift in (0.0, 1.0, 3.0)), ('mon', 'tue', 'wed')
    )
    calibration = {
        **GOOD.calibration,
        'strict': False,
        'held_out_novelty': known.to_dict(),
        'unlearned': {'labels': 4, 'miss_rate': 0.2, 'strict_miss_rate': 0.6},
    }
    manifest = dataclasses.replace(GOOD, calibration=calibration, false_alarm_rate=0.1)
    facts = list_facts(manifest)
    assert (
        facts['unknown'] == 'above novelty 1.50, for 10 % false rejection on average over sessions'
    )
    assert facts['false rejection, mean threshold'] == (
        '8.3 % on average, at most 20 % (wed); mon 0, tue 5, wed 20 (sessions held out; above '
        'novelty 19.00)'
    )
    assert facts['false rejection, strict threshold'].startswith('5.0 % on average, at most 15 %')
    assert '20 % of their trials receive a known label with the mean' in facts['unlearned labels']
    strict = dataclasses.replace(manifest, calibration={**calibration, 'strict': True})
    assert list_facts(strict)['unknown'].endswith('false rejection in most new sessions')


def test_files_hold_the_card_of_their_manifest(model_path):
    manifest = load_model(model_path).manifest
    card = load_model(model_path).card
    assert card == format_card(manifest)
    assert '- answers: texture, flexion: plate 0, plate 1, plate 2\n' in card
    assert '3 sessions was' in list_limits(manifest)[1]


def test_the_card_of_many_long_and_strange_labels_stays_short_plain_text(small_table, tmp_path):
    labels = [f'{i:03d}\x1b[2J\u202e{"x" * 900}' for i in range(18)]
    table = dataclasses.replace(small_table, labels=np.resize(labels, 36))
    write_model(tmp_path / 'm.npz', train(table, 'tree'))
    card = load_model(tmp_path / 'm.npz').card
    assert card.replace('\n', '').isprintable()
    assert len(card.encode()) < MAX_CARD_BYTES / 4
