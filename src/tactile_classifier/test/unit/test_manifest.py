# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import contextlib
import dataclasses
import json
import math

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.manifest import (
    format_card,
    FULL_WINDOW,
    Manifest,
    Stage,
    TrainingTrials,
)
from tactile_features.config import FeatureConfig
from tactile_features.onnx_container import MAX_CARD_BYTES
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
    versions={'numpy': '2.2.6'},
    cross_validation={'mean': 0.9, 'spread': 0.01, 'spread_of': 'folds', 'split': 'random'},
    created='2026-01-02T03:04:05+00:00',
    stages=(Stage(0, 1.5, -1.0, 0.1, 0.05, 0.9),),
    calibration={'split': 'one session held out', 'groups': 3, 'session_share': 0.75},
)


STAGE = dataclasses.asdict(FULL_WINDOW)
TRAINING = dataclasses.asdict(TrainingTrials(2, 1, 1, 0.02, 0.02, 120))


def test_round_trip():
    assert Manifest.from_dict(GOOD.to_dict()) == GOOD
    assert Manifest.from_dict(changed()) == GOOD
    assert Manifest.from_dict(changed(format_version=6)) == GOOD


def changed(**changes):
    return json.loads(json.dumps({**GOOD.to_dict(), **changes}))


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'format_version': 5}, 'format version 5, this software reads 6 and 7: train'),
        ({'specification_digest': 'ab' * 8}, 'not that of its feature specification'),
        ({'specification_digest': 7}, 'no valid entry "specification_digest"'),
        ({'format_version': None}, 'format version None'),
        ({'labels': 'pla'}, 'no valid entry "labels"'),
        ({'labels': ['pla', 3]}, 'no valid entry "labels"'),
        ({'labels': ['pla']}, 'not two or more different names'),
        ({'labels': ['pla', 'pla']}, 'not two or more different names'),
        ({'simulated': 1}, 'no valid entry "simulated"'),
        ({'trials': None}, 'no valid entry "trials"'),
        ({'task': 'texture'}, 'task "texture" does not go with its feature set'),
        ({'contact': 'palm'}, 'contact is "palm"'),
        ({'score_kind': 'odds'}, 'score_kind is "odds"; it must be one of votes'),
        ({'classifier': 'forest'}, 'classifier is "forest"'),
        ({'scaling': 'minmax'}, 'scaling is "minmax"'),
        ({'spec': {}}, 'manifest is damaged: .*no entry'),
        ({'training': {}}, 'no valid entry "training"'),
        ({'training': {**TRAINING, 'sessions': 1.5}}, 'no valid entry "sessions" in "training"'),
        ({'training': {**TRAINING, 'fastest_m_s': math.inf}}, 'no valid entry "fastest_m_s"'),
        ({'surprise': 1}, 'unknown entry "surprise"'),
        ({'stop_error_rate': 2.0}, 'a rate that is not between 0 and 1'),
        ({'stages': []}, 'its stages have'),
        ({'stages': 3}, 'no valid entry "stages"'),
        ({'stages': [{**STAGE, 'sample_count': 60}]}, r'its stages have \[60\]'),
        ({'stages': [{**STAGE, 'sample_count': True}]}, 'no valid entry "sample_count"'),
        ({'stages': [{**STAGE, 'novelty_threshold': math.inf}]}, '"novelty_threshold"'),
        ({'stages': [{**STAGE, 'novelty_threshold': math.nan}]}, '"novelty_threshold"'),
        ({'stages': [{**STAGE, 'more': 1}]}, 'no valid entry "stages"'),
    ],
)
def test_tampered_manifest_is_refused(changes, message):
    with pytest.raises(ModelFileError, match=message):
        Manifest.from_dict(changed(**changes))


@pytest.mark.parametrize('field', sorted(GOOD.to_dict().keys() - {'format_version'}))
def test_missing_entry_is_named(field):
    content = GOOD.to_dict()
    del content[field]
    with pytest.raises(ModelFileError, match=f'no valid entry "{field}"'):
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
        ['mean', 'split', 'groups', 'session_share', 'reason', 'choice', 'recalibrated',
         'unlearned', 'spread']
    ),
    JSON,
)  # fmt: skip
def test_any_entry_of_an_entry_may_hold_anything(where, name, value):
    check_card(**{where: {**getattr(GOOD, where), name: value}})


@pytest.mark.parametrize('entry', sorted(GOOD.spec.to_dict()))
def test_no_entry_of_the_specification_may_be_a_number_without_end(entry):
    spec = {**GOOD.spec.to_dict(), entry: 10**400}
    with pytest.raises(ModelFileError):
        Manifest.from_dict(changed(spec=spec))
