# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# %%
# # Your own pipeline
#
# Train a scikit-learn pipeline with features and a classifier of your choice, test it on held-out sessions, and write a model
# file for live nodes. ROS is not needed.
#
# The files here are SIMULATED: one for each window, `LABEL_SESSION_NUMBER.csv`, with 180 samples of tension [N] at 60 Hz.
import tempfile
from pathlib import Path

import numpy as np

scratch = tempfile.TemporaryDirectory()
folder = Path(scratch.name)
rng = np.random.default_rng(2)
time_s = np.arange(180) / 60.0


def touch(pitch_hz):
    wave = np.sin(2 * np.pi * (pitch_hz * time_s + rng.random()))
    return 3.0 + 0.05 * wave + rng.normal(0.0, 0.01, 180)


for label, pitch_hz in (('rough', 4.0), ('smooth', 9.0)):
    for session in ('monday', 'tuesday', 'friday'):
        for number in range(10):
            np.savetxt(folder / f'{label}_{session}_{number}.csv', touch(pitch_hz))

# %%
# ## Arrays
#
# `X` has one window per row; `y` has the labels, and `session` the groups that are held out.
files = sorted(folder.glob('*.csv'))
X = np.array([np.loadtxt(file) for file in files])
y, session, _ = np.array([file.stem.split('_') for file in files]).T
print(X.shape, np.unique(y), np.unique(session))

# %%
# ## Features and classifier
#
# Each feature set is a scikit-learn transformer, which also returns the names of its features. `cross_val_score` holds out one
# session at a time.
from sklearn.model_selection import LeaveOneGroupOut, cross_val_score
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline

from tactile_features.estimators import TextureSpectrum

pipe = make_pipeline(TextureSpectrum(rate_hz=60), KNeighborsClassifier(3))
print(cross_val_score(pipe, X, y, groups=session, cv=LeaveOneGroupOut()))
print(pipe[0].fit(X).get_feature_names_out()[:3])

# %%
# ## A model file
#
# `TactileClassifier` trains the pipeline as `tactile train` does: held-out sessions calibrate the probabilities and set the
# threshold for unknown objects.
from tactile_classifier import TactileClassifier

model = TactileClassifier(pipe).fit(X, y, groups=session)
model.save(folder / 'texture.npz')

# %%
# ## Labels
#
# `load_model` does not need scikit-learn, and the classifier node can use the same file. `predict` always returns a label;
# `predict_or_unknown` returns *unknown* for windows that differ from all training windows.
from tactile_classifier import load_model

loaded = load_model(folder / 'texture.npz')
new = np.array([touch(4.0), touch(9.0), touch(20.0)])
print(loaded.predict(new))
print(loaded.predict_or_unknown(new))
print(loaded.p_value(new).round(2))

# %%
# A pipeline that cannot be stored in a model file is refused:
from sklearn.linear_model import LogisticRegression

try:
    TactileClassifier(make_pipeline(TextureSpectrum(rate_hz=60), LogisticRegression())).fit(X, y)
except ValueError as error:
    print(error)
