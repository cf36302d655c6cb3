# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# %%
# # From file to label
#
# Classify one window of samples, without ROS. Replace the SIMULATED files by your own: `touches.npz` contains the training
# trials ([how to make it](../your_data.md#recordings-of-others)), `touch.csv` one new window.
import tempfile
from pathlib import Path

import numpy as np

scratch = tempfile.TemporaryDirectory()
folder = Path(scratch.name)
rng = np.random.default_rng(1)
time_s = np.arange(180) / 60.0


def touch(pitch_hz):
    wave = np.sin(2 * np.pi * (pitch_hz * time_s + rng.random()))
    return 3.0 + 0.05 * wave + rng.normal(0.0, 0.01, 180)


pitches = {'rough': 4.0, 'smooth': 9.0}
x = [[touch(pitch)] for pitch in pitches.values() for _ in range(30)]
np.savez(folder / 'touches.npz', x=x, label=np.repeat(list(pitches), 30), rate_hz=60.0)
np.savetxt(folder / 'touch.csv', touch(9.0), header='tension_n')

# %%
# ## Train once
from tactile_classifier import load_archive, table_from_trials, train, write_model

table = table_from_trials('texture', load_archive(folder / 'touches.npz'))
write_model(folder / 'texture.npz', train(table, 'knn'))

# %%
# ## Classify
#
# `tactile train` writes the same file, and the live classifier returns the same numbers for the same window.
from tactile_classifier import load_model

model = load_model(folder / 'texture.npz')
answer = model.classify(np.loadtxt(folder / 'touch.csv'), rate_hz=60)
print(answer.label, {label: round(p, 2) for label, p in answer.probabilities.items()})

# %%
# A window unlike all training trials is unknown. `p_value` is the fraction of held-out known trials that are as novel.
strange = model.classify(touch(20.0), rate_hz=60)
print(f'{strange.label}, p = {strange.p_value:.2f}: {strange.reason}')

# %%
# A window without features has the label `no answer` and a reason. A wrong rate or length raises an error with a remedy.
from tactile_classifier import DatasetError

try:
    model.classify(np.ones(300), rate_hz=60)
except DatasetError as error:
    print(str(error).replace(model.model_id, 'ID'))
