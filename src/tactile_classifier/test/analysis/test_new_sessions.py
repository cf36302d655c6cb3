# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rejection of unknown objects in new sessions, with features that differ by session."""

from classifier_tables import make_table
import numpy as np
import pytest

from tactile_classifier.training.trainer import train


def draw(rng, means, sessions, each, effect):
    """Return features, labels and sessions; ``effect`` scales the session offsets."""
    labels = np.tile(np.repeat([f'label {i}' for i in range(len(means))], each), sessions)
    session = np.repeat(np.arange(sessions), len(means) * each)
    values = np.tile(np.repeat(means, each, axis=0), (sessions, 1))
    values = values + rng.normal(size=values.shape)
    return values + effect * rng.normal(size=(sessions, means.shape[1]))[session], labels, session


def judge(seed, *, features, apart, sessions, each, effect, strict=False):
    """Return a model of five labels, novelties of new trials, and True for a sixth label."""
    rng = np.random.default_rng(seed)
    means = apart * rng.normal(size=(6, features))
    values, labels, session = draw(rng, means[:5], sessions, each, effect)
    trained = train(make_table(labels, values, session_id=session), 'knn', strict=strict)
    values, labels, _ = draw(rng, means, 30, 3, effect)
    return trained, trained.novelty.compute(values), labels == 'label 5'


def test_the_rate_holds_in_the_mean_over_new_sessions():
    rejected = {False: [], True: []}
    missed = {False: [], True: []}
    for seed in range(6):
        for strict in (False, True):
            trained, novelty, is_new = judge(
                seed, features=6, apart=3.0, sessions=6, each=6, effect=0.5, strict=strict
            )
            is_unknown = novelty > trained.manifest.confidence.novelty_threshold
            rejected[strict].append(is_unknown[~is_new].mean())
            missed[strict].append(1.0 - is_unknown[is_new].mean())
    # The nominal rate is 5 %. The strict threshold is larger, so it rejects fewer trials.
    assert 0.035 < np.mean(rejected[False]) < 0.07
    assert np.mean(rejected[True]) < 0.02
    assert np.mean(missed[True]) > np.mean(missed[False]) + 0.1


@pytest.mark.parametrize(
    ('features', 'apart', 'each', 'effect'),
    [
        (6, 3.0, 10, 0.7),
        (6, 3.0, 4, 1.5),
        (40, 1.5, 10, 0.7),
        (40, 1.5, 4, 1.5),
        (91, 1.0, 10, 0.7),
    ],
)
def test_two_sessions_judge_held_out_trials_as_the_model_judges_new_ones(
    features, apart, each, effect
):
    ratios, rejected = [], []
    for seed in range(4):
        trained, novelty, is_new = judge(
            seed, features=features, apart=apart, sessions=2, each=each, effect=effect
        )
        held_out = np.concatenate(trained.manifest.calibration['held_out_novelty']['sessions'])
        ratios.append(np.median(novelty[~is_new]) / np.median(held_out))
        threshold = trained.manifest.confidence.novelty_threshold
        rejected.append(np.mean(novelty[~is_new] > threshold))
    # New trials are compared with training trials of two sessions, but held-out trials only with
    # those of one session. Their novelties must nevertheless be similar.
    assert 0.7 < np.mean(ratios) < 1.1
    assert np.mean(rejected) < 0.15
