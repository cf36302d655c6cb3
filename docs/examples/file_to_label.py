# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# %%
# # From CSV files to a label
#
# Read a folder of CSV files, train a model, measure its accuracy on held-out days, and classify a new file. ROS is not needed.
#
# The files here are SIMULATED: one for each glide, with the columns `time_s` and `force_n`, in a folder for each day and label,
# such as `lab/day1/rough/0.csv`. To use your own files, skip this cell and set `folder`
# ([other forms of files](../your_data.md#recordings-of-others)).
import tempfile
from pathlib import Path

import numpy as np

scratch = tempfile.TemporaryDirectory()
folder = Path(scratch.name)
rng = np.random.default_rng(1)
time_s = np.arange(180) / 60.0


def write_glide(path, pitch_hz):
    wave = np.sin(2 * np.pi * (pitch_hz * time_s + rng.random()))
    force_n = 3.0 + 0.05 * wave + rng.normal(0.0, 0.02, 180)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, np.column_stack([time_s, force_n]), '%.6f', ',', header='time_s,force_n', comments='')


for day in ('day1', 'day2', 'day3'):
    for label, pitch_hz in (('coarse', 4.0), ('fine', 9.0)):
        for number in range(10):
            write_glide(folder / 'lab' / day / label / f'{number}.csv', pitch_hz)

# %%
# ## Load
#
# The label and the day are the names of the folders. The notes state what was read, with the units.
from tactile_analysis import TrialSet

trials = TrialSet.load(folder / 'lab').even()
X, y, day = trials.windows('day')
X = X[:, 0]  # the only channel
print(*trials.notes, sep='\n')
print(X.shape, np.unique(y), np.unique(day), f'{trials.rate_hz:g} Hz')

# %%
# ## Look
#
# Check unit, length and contact of a few trials before you train.
from matplotlib import pyplot as plt

figure, axes = plt.subplots(1, 2, figsize=(8, 2.5), sharey=True, layout='constrained')
for axis, label in zip(axes, np.unique(y)):
    axis.plot(np.arange(X.shape[1]) / trials.rate_hz, X[y == label][0], linewidth=1)
    axis.set(title=f'SIMULATED: {label}', xlabel='time [s]')
axes[0].set_ylabel('force [N]')

# %%
# ## Accuracy on a new day
#
# Each day is held out once, so no test trial has a neighbour from its own day in the training.
from sklearn.model_selection import LeaveOneGroupOut, cross_val_score
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline

from tactile_features.estimators import TextureSpectrum

pipe = make_pipeline(TextureSpectrum(rate_hz=trials.rate_hz), KNeighborsClassifier(3))
scores = cross_val_score(pipe, X, y, groups=day, cv=LeaveOneGroupOut())
print(f'{len(y)} trials, chance 50 %; accuracy of each held-out day in %:', 100 * scores)

# %%
# ## Train and save
#
# The held-out days also calibrate the probabilities and set the threshold for unknown objects.
from tactile_classifier import TactileClassifier

TactileClassifier(pipe).fit(X, y, groups=day).save(folder / 'texture.npz')

# %%
# ## Classify a new file
#
# `load_model` does not need scikit-learn. The classifier node loads the same file, and returns the same numbers for the same
# window.
write_glide(folder / 'new.csv', 9.0)
program = """
import sys
import numpy as np
from tactile_classifier import load_model

model = load_model('texture.npz')
force_n = np.loadtxt('new.csv', delimiter=',', skiprows=1)[:, 1]
prediction = model.classify(force_n, rate_hz=60)
print(prediction.label, {label: round(p, 2) for label, p in prediction.probabilities.items()})
print('scikit-learn was imported:', 'sklearn' in sys.modules)
"""
import subprocess
import sys

print(subprocess.run([sys.executable, '-c', program], cwd=folder, check=True, capture_output=True, text=True).stdout)

# %%
# ## Unknown objects
#
# A window that differs from all training trials is unknown. `p_value` is the fraction of held-out trials whose novelty is at
# least as high.
from tactile_classifier import load_model

model = load_model(folder / 'texture.npz')
write_glide(folder / 'strange.csv', 20.0)
with TrialSet.load(folder / 'strange.csv') as strange:
    signal = strange.trials[0].signal
prediction = model.classify(signal.values, signal.rate_hz)
print(f'{prediction.label}, p = {prediction.p_value:.2f}: {prediction.reason}')

# %%
# A window without features has the label `no answer` and a reason. A wrong rate or length raises an error with a remedy.
from tactile_classifier import DatasetError

try:
    model.classify(np.ones(300), rate_hz=60)
except DatasetError as error:
    print(str(error).replace(model.model_id, 'ID'))
