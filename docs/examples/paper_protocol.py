# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# %%
# # The paper's protocol on public recordings
#
# The protocol consists of 91 Fourier magnitudes, four classifiers, six-fold cross-validation that is repeated ten times, and
# rank-sum tests. The cross-validation uses functions of scikit-learn.
#
# The recordings are 252 slides of a finger over 7 fabrics ([origin and licence](../real_recordings.md#fabrics)). They are not
# part of this repository: convert `data/fabric` of [FabricSlide](https://github.com/wngfra/FabricSlide) to an
# [archive](../your_data.md#archives-of-others) `fabric_slide.npz`, and set `TACTILE_DATA` to its folder.
# Without the file, SIMULATED slides of the same form replace them, as on this page.
import os
from pathlib import Path

import numpy as np


def simulate_slides():
    """Return 108 SIMULATED slides: a pitch, amplitude and noise for each of 6 fabrics, at four speeds."""
    rng = np.random.default_rng(3)
    fabric = np.repeat(np.arange(6), 18)
    speed_mm_s = np.tile([10.0, 20.0, 50.0, 100.0], 27)
    pitch_mm = (9.0 + 1.2 * fabric) * rng.normal(1.0, 0.02, 108)
    cycles = np.outer(speed_mm_s / pitch_mm, np.arange(180) / 35.61) + rng.random((108, 1))
    noise_n = (0.04 + 0.02 * fabric)[:, np.newaxis]
    x = 3.0 + 0.1 * np.sin(2 * np.pi * cycles) + rng.normal(0.0, noise_n, cycles.shape)
    label = np.char.add('fabric ', fabric.astype(str))
    return {'x': x[:, np.newaxis], 'label': label, 'speed_mm_s': speed_mm_s, 'balanced': fabric >= 0, 'rate_hz': 35.61}


file = Path(os.environ.get('TACTILE_DATA', '.')) / 'fabric_slide.npz'
trials = np.load(file) if file.is_file() else simulate_slides()
keep = trials['balanced'].astype(bool)
X = trials['x'][keep].mean(axis=1, dtype=float)
y, speed_mm_s = trials['label'][keep], trials['speed_mm_s'][keep]
rate_hz = float(trials['rate_hz'])
print(file.name if file.is_file() else 'SIMULATED', X.shape, len(np.unique(y)), 'labels')

# %%
# ## Features
#
# The mean of each window is subtracted; 180 samples have 91 magnitudes, at 0 Hz to half the sample rate.
from tactile_features.estimators import TextureSpectrum

features = TextureSpectrum(rate_hz=rate_hz, detrend='mean')
spectra = features.fit_transform(X)
print(spectra.shape, *features.get_feature_names_out()[[0, 1, -1]])

# %%
# ## Accuracy
#
# Six stratified folds, ten times: mean and standard deviation of the ten repetitions in %. State the scaling with a result:
# it changes the accuracy in both directions.
from sklearn.model_selection import LeaveOneGroupOut, RepeatedStratifiedKFold, cross_val_score
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier

classifiers = {
    '3 neighbours': KNeighborsClassifier(3),
    'SVM linear': SVC(kernel='linear'),
    'SVM RBF': SVC(),
    'tree': DecisionTreeClassifier(random_state=0),
}
folds = RepeatedStratifiedKFold(n_splits=6, n_repeats=10, random_state=0)
accuracies = {}
for name, classifier in classifiers.items():
    for scaler in ('passthrough', StandardScaler()):
        pipe = make_pipeline(scaler, classifier)
        score = 100 * cross_val_score(pipe, spectra, y, cv=folds).reshape(10, 6).mean(axis=1)
        accuracies[name, 'not scaled' if scaler == 'passthrough' else 'scaled'] = score.mean()
        print(f'{name:12s} {"not scaled" if scaler == "passthrough" else "scaled":10s} {score.mean():5.1f} ± {score.std():.1f}')

# %%
# The features do not depend on other trials, so they were computed once, outside the folds. The scaling is fitted to trials, so it
# belongs in the pipeline.
#
# ## Accuracy at a new speed
#
# With random folds, the test slides have the same speeds as the training slides. Hold out one speed to measure the accuracy at a
# new speed.
for name, classifier in classifiers.items():
    score = 100 * cross_val_score(classifier, spectra, y, groups=speed_mm_s, cv=LeaveOneGroupOut()).mean()
    print(f'{name:12s} not scaled {score:5.1f}')

# %%
# ## Significance
#
# Wilcoxon's rank-sum test of every two labels for each magnitude, and its mean p-value over the pairs, as in the paper. Each
# trial counts as independent, although repeated slides are not.
from matplotlib import pyplot as plt

from tactile_classifier import rank_sum_p_values

p = rank_sum_p_values(spectra, y).mean_p
print(f'{np.mean(p[1:] < 0.05):.0%} of the components above 0 Hz have a mean p below 0.05')

figure, axes = plt.subplots(1, 2, figsize=(10, 3), layout='constrained')
axes[0].barh([' '.join(key) for key in accuracies], accuracies.values())
axes[0].axvline(100 / len(np.unique(y)), color='black', linestyle=':', label='chance')
axes[0].set(xlabel='accuracy [%]', xlim=(0, 100), title='six folds, ten times')
axes[1].plot(np.fft.rfftfreq(X.shape[1], 1 / rate_hz), p)
axes[1].axhline(0.05, color='black', linestyle=':', label='p = 0.05')
axes[1].set(xlabel='frequency [Hz]', ylabel='mean p', title='rank-sum tests of every two labels')
for axis in axes:
    axis.legend()
figure.suptitle(f'{file.name if file.is_file() else "SIMULATED"}: {len(y)} trials')
