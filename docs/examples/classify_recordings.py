# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# %%
# # Classify your own recordings
#
# From arrays to a model file, in Python and without ROS. SIMULATED trials replace your recordings: six sessions of six
# glides over each of eight plates.
import tempfile
from pathlib import Path

import numpy as np

from tactile_bringup.trial_protocols import TrialConfig
from tactile_bringup.trial_protocols import TrialRequest
from tactile_analysis import compute_tables, FeatureOptions, TrialSet
from tactile_classifier import evaluate, load_model, train, write_model
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics.trials import simulate_trials

catalogue = Catalogue(None)
planned = plan_trial(TrialConfig(), TrialRequest('texture', 'flexion'), catalogue)
glide_s = dict(planned.phases)['glide']
parts = [
    (label, session, simulate_trials('texture', label, 'flexion', planned.timeline, 6, seed=1, session=session))
    for label in catalogue.labels('texture')
    for session in range(6)
]

# %%
# ## The archive
#
# One NumPy file with `x` (trials, channels, samples), `label` and `rate_hz`; any other array is a column. Here the column
# `session` identifies trials of the same session.
tensions, labels, sessions = [], [], []
for label, session, trials in parts:
    for tension_n in trials.tension_n:
        first = np.searchsorted(trials.sample_times_s, glide_s + 0.6)
        tensions.append(tension_n[first : first + 120])
        labels.append(label)
        sessions.append(session)
scratch = tempfile.TemporaryDirectory()
folder = Path(scratch.name)
np.savez(folder / 'trials.npz', x=np.array(tensions)[:, None, :], label=labels, rate_hz=60.0, session=sessions)

# %%
# ## Features and accuracy
#
# Each trial is one window of two seconds. The live node computes the same features.
trials = TrialSet.load(folder / 'trials.npz')
tables, left_out = compute_tables(trials, FeatureOptions(task='texture'))
(table,) = tables.values()
print(len(table), 'trials,', table.values.shape[1], 'features, such as', table.spec.names[1])

# %%
# Accuracy with random folds, and with whole sessions held out. Use the latter: with random folds, the test trials are
# similar to training trials of the same session.
for hold_out in ((), ('session',)):
    score = evaluate(table, ['knn'], ['none'], hold_out=hold_out).scores[0]
    print(f'{score.split}: {100 * score.mean:.0f} %')

# %%
# ## The model file
#
# The file contains the specification of the features, the classifier, the calibration and a model card; the live classifier loads
# the same file. This model is trained on five sessions and tested on the sixth. Windows that differ from all training trials are
# `unknown`.
is_last = table.column('session') == 5
write_model(folder / 'texture.npz', train(table.take(~is_last), 'knn'))
model = load_model(folder / 'texture.npz')
later = table.take(is_last)
answers = model.predict_or_unknown(later.values)
print(model.labels)
right, unknown = np.mean(answers == later.labels), np.mean(answers == 'unknown')
print(f'{len(later)} trials of the sixth session: {right:.1%} correct, {unknown:.1%} unknown')
