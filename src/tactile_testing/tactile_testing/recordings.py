# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks that every kind of recording of trials must pass."""

import numpy as np


def check_source(load):
    """Check that a source of trials, such as a reader of recordings, follows these rules.

    ``load`` is a function that opens the same recording each time. The rules are:

    - Loading twice gives the same trials.
    - Each trial that is not excluded has a label, and a finite signal with increasing times.
    - The signal of a trial is read only once.
    - `windows` and `to_table` contain the same trials.
    """
    with load() as recording, load() as again:
        assert recording.trials
        assert recording.trials is recording.trials
        for trial, same in zip(recording.trials, again.trials, strict=True):
            assert describe(trial) == describe(same)
            if not trial.why_not:
                assert trial.label
                check_signal(trial)
                np.testing.assert_array_equal(trial.signal.values, same.signal.values)
        counted = [trial for trial in recording.trials if not trial.why_not]
        x, labels, _ = recording.windows()
        assert labels.tolist() == [trial.label for trial in counted]
        assert x.dtype == np.float64
        assert x.shape[:2] == (len(counted), len(counted[0].signal.channels))
        assert recording.even().rate_hz > 0
        assert recording.to_table().num_rows == sum(
            trial.signal.values.shape[1] for trial in counted
        )


class Archive:
    """The arrays of an archive (``.npz``). Arrays without an own attribute are in ``columns``."""

    def __init__(self, path):
        with np.load(path) as content:
            arrays = dict(content)
        self.x, self.label = arrays.pop('x'), arrays.pop('label')
        self.rate_hz, self.unit = float(arrays.pop('rate_hz')), str(arrays.pop('unit', ''))
        channels = [f'channel_{i}' for i in range(self.x.shape[1])]
        self.channels = tuple(arrays.pop('channel_names', channels))
        self.lengths = arrays.pop('length', np.full(len(self.x), self.x.shape[2]))
        self.columns = arrays

    def __len__(self):
        return len(self.label)


def describe(trial):
    return trial.name, trial.label, trial.session_id, trial.contact, trial.why_not


def check_signal(trial):
    signal = trial.signal
    assert trial.signal is signal
    assert signal.values.dtype == np.float64
    channels, samples = signal.values.shape
    assert channels == len(signal.channels) > 0
    assert samples > 0
    assert np.isfinite(signal.values).all()
    assert signal.rate_hz > 0
    assert signal.time_s.shape == (samples,)
    assert signal.time_s[0] >= 0
    assert (np.diff(signal.time_s) > 0).all()
