# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# %%
# # How good must my sensor be?
#
# Use simulated trials to choose a sensor: the same glides are measured with increasing noise. All numbers on this page
# are SIMULATED. The benchmark `robustness` repeats this for five conditions of sensor and rig.
from dataclasses import replace

import numpy as np
from matplotlib import pyplot as plt
from sklearn.neighbors import KNeighborsClassifier

from tactile_bringup.trial_protocols import TrialConfig
from tactile_bringup.trial_protocols import TrialRequest
from tactile_features import features_from_trials
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim import Catalogue, simulate_trials

catalogue = Catalogue(None)
rig = catalogue.rig()
planned = plan_trial(TrialConfig(), TrialRequest('texture', 'flexion'), catalogue)
print(f'the load cell of the simulated rig: {rig.load_cell.noise_n:g} N of noise, {rig.load_cell.rate_hz:g} Hz')

# %%
# ## Trials with another sensor
#
# Each plate has eight glides in each of four sessions. The same seed gives the same motion, so only the sensor differs.
# Features are computed from three seconds, starting 0.6 s after the start of the glide.


def simulate(noise_n):
    sensor = replace(rig.load_cell, noise_n=noise_n)
    noisy = catalogue.with_rig(replace(rig, load_cell=sensor))
    windows, labels, sessions = [], [], []
    for label in catalogue.labels('texture'):
        for session in range(4):
            trials = simulate_trials(
                'texture', label, 'flexion', planned.timeline, 8, seed=1, session=session, catalogue=noisy
            )
            first = np.searchsorted(trials.sample_times_s, dict(planned.phases)['glide'] + 0.6)
            windows.extend(trials.tension_n[:, first : first + 180])
            labels += 8 * [label]
            sessions += 8 * [session]
    values, _ = features_from_trials('texture', windows, sensor.rate_hz)
    return values, np.array(labels), np.array(sessions)


# %%
# ## Accuracy
#
# A k-nearest-neighbours classifier is trained on two sessions and tested on two others, with the same noise in both.
# With eight plates, chance is 12.5 %.
noises_n = [0.003, 0.01, 0.03, 0.1, 0.3]
accuracies = []
for noise_n in noises_n:
    values, labels, sessions = simulate(noise_n)
    known = sessions < 2
    model = KNeighborsClassifier(3).fit(values[known], labels[known])
    accuracies.append(model.score(values[~known], labels[~known]))
    print(f'{noise_n:5g} N: {100 * accuracies[-1]:.0f} % of {np.sum(~known)} trials')

# %%
figure, axes = plt.subplots(figsize=(6, 3), layout='constrained')
axes.semilogx(noises_n, [100 * accuracy for accuracy in accuracies], 'o-')
axes.axhline(12.5, linestyle=':', color='gray', label='chance')
axes.legend()
axes.set(xlabel='noise of the sensor [N]', ylabel='accuracy [%]', title='SIMULATED: texture, flexion', ylim=(0, 103))
