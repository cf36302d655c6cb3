# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writes labelled-trials archives."""

from __future__ import annotations

from pathlib import Path
import zipfile

import numpy as np

from tactile_classifier.datasets.archive import LabelledTrials


def save_archive(path: Path, trials: LabelledTrials) -> None:
    """Write trials as an archive that `load_archive` reads, replacing the file."""
    arrays = {
        **trials.columns,
        'x': trials.x,
        'label': trials.label,
        'rate_hz': np.array(trials.rate_hz),
    }
    if (trials.lengths != trials.x.shape[2]).any():
        arrays['length'] = trials.lengths
    # Not by numpy.savez: it cannot hold a column that is named as one of its arguments.
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            with archive.open(f'{name}.npy', 'w', force_zip64=True) as member:
                array = np.asarray(array)
                np.lib.format.write_array(member, array, allow_pickle=False)  # type: ignore[no-untyped-call]
