# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
