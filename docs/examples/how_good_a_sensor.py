# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# %%
# # How good must my sensor be?
#
# Simulated trials answer before anything is bought: the same glides are sensed with more and more noise. All numbers
# here are SIMULATED. `tactile robustness` does this for eight conditions of sensor and rig.
from dataclasses import replace

from matplotlib import pyplot as plt

from tactile_lab.simulation.robustness import Study, make_features, score
from tactile_lab.simulation.robustness_axes import Sensing, Setting
from tactile_sim.descriptions.catalogue import Catalogue

catalogue = Catalogue(None)
cell = catalogue.rig().load_cell
print(f'the load cell of the simulated rig: {cell.noise_n:g} N of noise, {cell.rate_hz:g} Hz')

# %%
# ## Settings
#
# One setting for each amount of noise. The motion is simulated once; only the sensing differs.
noises_n = [0.003, 0.01, 0.03, 0.1, 0.3]
settings = [Setting('noise', noise_n, sensing=Sensing(noise_n=noise_n)) for noise_n in noises_n]
study = replace(Study(), train_sessions=2, test_sessions=2)

# %%
# ## Accuracy
#
# A k-nearest-neighbours classifier is trained in two sessions and tested in two others, with the same noise in both.
# Eight plates: guessing gives 12.5 %.
accuracies = []
for setting, (train, test) in zip(settings, make_features(study, catalogue, 'texture', settings), strict=True):
    accuracies.append(score('texture', train, test))
    print(f'{setting.value:5g} N: {100 * accuracies[-1]:.0f} % of {test.trials} trials')

# %%
figure, axes = plt.subplots(figsize=(6, 3), layout='constrained')
axes.semilogx(noises_n, [100 * accuracy for accuracy in accuracies], 'o-')
axes.axhline(12.5, linestyle=':', color='gray', label='chance')
axes.legend()
axes.set(xlabel='noise of the sensor [N]', ylabel='accuracy [%]', title='SIMULATED: texture, flexion', ylim=(0, 103))
