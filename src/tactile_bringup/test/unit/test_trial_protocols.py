# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import pytest

from tactile_bringup.trial_protocols import (
    glide_speed_m_s,
    GuideStep,
    longest_trial_s,
    ProtocolError,
    TendonStep,
    trial_steps,
    TrialConfig,
    TrialRequest,
    WaitStep,
)

CONFIG = TrialConfig()


def test_texture_follows_the_paper():
    steps = trial_steps(CONFIG, TrialRequest('texture', 'flexion'))
    phases = list(dict.fromkeys(step.phase for step in steps))
    assert phases == ['approach', 'contact', 'glide', 'release', 'return']
    (glide,) = (step for step in steps if step.phase == 'glide')
    assert isinstance(glide, GuideStep)
    assert glide.speed_m_s == 0.015
    assert glide.position_m == pytest.approx(CONFIG.guide_start_m + CONFIG.glide_length_m)


def test_stiffness_holds_for_four_seconds_and_releases():
    steps = trial_steps(CONFIG, TrialRequest('stiffness', 'abduction'))
    assert [step.phase for step in steps] == ['approach', 'contact', 'hold', 'release']
    assert steps[1] == TendonStep(
        'contact', CONFIG.abduction_displacement_m, CONFIG.pull_speed_m_s
    )
    assert steps[2] == WaitStep('hold', 4.0)
    assert steps[3].displacement_m == 0.0


def test_request_overrides_speed_and_hold():
    fast = TrialRequest('texture', 'flexion', glide_speed_m_s=0.03)
    assert glide_speed_m_s(CONFIG, fast) == trial_steps(CONFIG, fast)[3].speed_m_s == 0.03
    long = TrialRequest('stiffness', 'flexion', hold_s=10.0)
    assert trial_steps(CONFIG, long)[2].duration_s == 10.0
    assert glide_speed_m_s(CONFIG, long) == 0.0


@pytest.mark.parametrize('hold_s', [0.5, 4.0, 3600.0])
def test_a_trial_may_take_as_long_as_it_was_asked_to_hold(hold_s):
    longest_s = longest_trial_s(CONFIG, TrialRequest('stiffness', 'flexion', hold_s=hold_s))
    assert hold_s + 50 < longest_s < hold_s + 120
    slow = TrialRequest('texture', 'flexion', glide_speed_m_s=0.001)
    assert longest_trial_s(CONFIG, slow) > 65


@pytest.mark.parametrize(
    ('arguments', 'word'),
    [
        (('smell', 'flexion'), 'smell'),
        (('texture', 'extension'), 'extension'),
        (('texture', 'flexion', '', '', '', -0.01), 'glide_speed_m_s'),
        (('stiffness', 'flexion', '', '', '', 0.0, float('nan')), 'hold_s'),
    ],
)
def test_bad_request_is_refused_by_name(arguments, word):
    with pytest.raises(ProtocolError, match=word):
        TrialRequest(*arguments)
