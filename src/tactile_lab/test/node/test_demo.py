# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile demo` with few trials."""

from functools import partial
import json

from tactile_command import ask_tactile, let_rigs_home_fast

from tactile_classifier.estimators import random_convolutions
from tactile_lab.commands import train
from tactile_lab.experiment import live_rig


def test_short_demo_replays_equal_and_writes_its_results(tmp_path, monkeypatch):
    """Takes more than 10 s: training, live trials, and replay in real time."""
    # Cross-validation is shortened, because other tests cover it.
    monkeypatch.setattr(train, 'train_models', partial(train.train_models, repetitions=1, folds=2))
    monkeypatch.setattr(random_convolutions, 'FEATURES', 168)
    quick = {'trial_runner': {'approach_speed_m_s': 0.1}}
    monkeypatch.setattr(live_rig, 'LiveSetup', partial(live_rig.LiveSetup, parameters=quick))
    let_rigs_home_fast(monkeypatch.setattr)
    folder = tmp_path / 'demo'
    summary = ask_tactile(
        'demo', '-o', folder, '--seed', 3, '--short', '--trials', 2, '--no-watch'
    )
    assert summary == json.loads((folder / 'summary.json').read_text())
    assert summary['simulated'] is True
    protocols = [trial['protocol'] for trial in summary['live_trials']]
    assert protocols == ['texture', 'stiffness']
    for trial in summary['live_trials']:  # a label, or sometimes "unknown" (false rejection)
        assert trial['answer'] or 'unlike all' in trial['reason'], trial
    (report,) = summary['replay']
    assert report['equal']
    for comparison in report['comparisons'].values():
        # There are more windows if a trial was repeated because the computer was busy.
        assert comparison['window_count'] == comparison['classification_count'] >= 2
    assert len(list((folder / 'models').glob('*.npz'))) == 4
    for plot in ('strain_trace.png', 'texture_spectra.png'):
        assert (folder / plot).read_bytes().startswith(b'\x89PNG')
