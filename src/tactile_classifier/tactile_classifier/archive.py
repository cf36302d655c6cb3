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

"""Labelled-trials archives: raw signals of many trials in one NumPy ``.npz`` file.

``x`` (trials, channels, samples), ``label`` (trials,), ``rate_hz`` () and any number
of further columns (trials,) to select, group or hold out by. No pickled objects.
"""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
import math
from pathlib import Path
from typing import Any, IO
import zipfile

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import DatasetError

MAX_ARCHIVE_BYTES = 2**30
"""Archives whose arrays take more than this are not loaded [byte]."""

Array = npt.NDArray[Any]


MAX_MAGNITUDE = 1e100
"""Largest absolute value in an archive [its unit]."""


@dataclasses.dataclass(frozen=True)
class LabelledTrials:
    """Raw signals of many trials, with what is known about each.

    Attributes
    ----------
    x : ndarray of shape (trials, channels, samples)
        Signals, in the unit of their source.
    label : ndarray of str, shape (trials,)
    rate_hz : float
        Sample rate [Hz].
    columns : mapping of str to ndarray of shape (trials,)
    """

    x: Array
    label: Array
    rate_hz: float
    columns: Mapping[str, Array]

    def __len__(self) -> int:
        return len(self.label)

    def signal(self, channel: int | None = None) -> npt.NDArray[np.float64]:
        """Return one channel, or the mean of all, shape (trials, samples).

        Raises
        ------
        DatasetError
            When there is no such channel.
        """
        if channel is None:
            return np.asarray(self.x.mean(axis=1, dtype=np.float64))
        if not 0 <= channel < self.x.shape[1]:
            raise DatasetError(
                f'there is no channel {channel}: the archive has {self.x.shape[1]}, from 0'
            )
        return self.x[:, channel].astype(np.float64)

    def where(self, column: str, value: object = True) -> LabelledTrials:
        """Return the trials whose column has this value.

        Raises
        ------
        DatasetError
            When there is no such column, or no such trial.
        """
        if column not in self.columns:
            raise DatasetError(
                f'there is no column "{column}"; there are: {", ".join(self.columns) or "none"}'
            )
        keep = np.asarray(self.columns[column] == value)
        if keep.shape != self.label.shape or not keep.any():
            raise DatasetError(f'no trial has {column} = {value}')
        return LabelledTrials(
            self.x[keep],
            self.label[keep],
            self.rate_hz,
            {name: values[keep] for name, values in self.columns.items()},
        )

    def between(self, start_s: float, stop_s: float) -> LabelledTrials:
        """Return the samples from ``start_s`` up to, not including, ``stop_s``.

        Raises
        ------
        DatasetError
            When the trials do not last so long, or no sample is left.
        """
        samples = self.x.shape[2]
        first, last = (round(t * self.rate_hz, 6) for t in (start_s, stop_s))
        if not 0 <= first < last <= samples:
            raise DatasetError(
                f'the trials last {samples / self.rate_hz:.6g} s; '
                f'{start_s:g} to {stop_s:g} s is not a part of them'
            )
        cut = slice(math.ceil(first), math.ceil(last))
        return dataclasses.replace(self, x=self.x[:, :, cut])


def load_archive(path: str | Path, folds: int = 6) -> LabelledTrials:
    """Read a labelled-trials archive.

    Parameters
    ----------
    path : str or Path
    folds : int
        Fewer trials than this are refused: they cannot be cross-validated.

    Raises
    ------
    DatasetError
        With a sentence that says what is wrong with the file.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as archive:
            _check_headers(path, archive)
        with np.load(path, allow_pickle=False) as content:
            arrays = {name: content[name] for name in content.files}
    except FileNotFoundError:
        raise DatasetError(f'{path} does not exist') from None
    except DatasetError:
        raise
    except Exception as error:  # zipfile, zlib and NumPy each have their own
        raise DatasetError(f'{path} is not a readable .npz archive: {error}') from error
    return _check_trials(path, arrays, folds)


def _check_headers(path: Path, archive: zipfile.ZipFile) -> None:
    """Refuse what must not be loaded, by what the headers announce."""
    total = 0
    for member in archive.infolist():
        if not member.filename.endswith('.npy'):
            raise DatasetError(f'{path} holds {member.filename}, which is not an array')
        name = member.filename.removesuffix('.npy')
        with archive.open(member) as stream:
            shape, dtype = _read_header(stream)
        if dtype.hasobject:
            raise DatasetError(
                f'array {name} in {path} holds pickled objects, which are never loaded: '
                'save it with a numeric, boolean or string type'
            )
        total += math.prod(shape) * dtype.itemsize
    if total > MAX_ARCHIVE_BYTES:
        raise DatasetError(
            f'{path} unpacks to {total / 2**20:.0f} MiB; '
            f'the limit is {MAX_ARCHIVE_BYTES / 2**20:.0f} MiB'
        )


def _read_header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = np.lib.format.read_magic(stream)  # type: ignore[no-untyped-call]
    read = np.lib.format.read_array_header_1_0
    if version != (1, 0):
        read = np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)  # type: ignore[no-untyped-call]
    return shape, dtype


def _check_trials(path: Path, arrays: dict[str, Array], folds: int) -> LabelledTrials:
    missing = [key for key in ('x', 'label', 'rate_hz') if key not in arrays]
    if missing:
        raise DatasetError(f'{path} has no {" and no ".join(missing)}')
    x, label, rate = arrays.pop('x'), arrays.pop('label'), arrays.pop('rate_hz')
    if x.ndim != 3 or x.dtype.kind not in 'fiub' or 0 in x.shape:
        raise DatasetError(
            f'x in {path} is {x.dtype} of shape {x.shape}; '
            'it must be numbers of shape (trials, channels, samples)'
        )
    trials = len(x)
    if label.shape != (trials,) or label.dtype.kind not in 'Uiu':
        raise DatasetError(
            f'label in {path} is {label.dtype} of shape {label.shape}; '
            f'it must be strings or integers of shape ({trials},), one a trial'
        )
    if rate.size != 1 or rate.dtype.kind not in 'fiu' or not 0 < float(rate.item()) < math.inf:
        raise DatasetError(f'rate_hz in {path} must be one positive number')
    for name, column in arrays.items():
        if column.shape != (trials,):
            raise DatasetError(
                f'column {name} in {path} has shape {column.shape}; it must be ({trials},)'
            )
    bad = np.flatnonzero(~np.isfinite(x).all(axis=(1, 2)))
    if len(bad):
        raise DatasetError(
            f'x in {path} is not finite in {len(bad)} of {trials} trials, first in trial {bad[0]}'
        )
    if np.abs(x).max() > MAX_MAGNITUDE:
        raise DatasetError(
            f'x in {path} has values beyond {MAX_MAGNITUDE:g}, whose squares would overflow; '
            'scale it'
        )
    label = label.astype(str)
    if len(np.unique(label)) < 2:
        raise DatasetError(f'{path} has one class only, "{label[0]}": nothing to tell apart')
    if trials < folds:
        raise DatasetError(f'{path} has {trials} trials, fewer than the {folds} folds')
    return LabelledTrials(x, label, float(rate.item()), arrays)
