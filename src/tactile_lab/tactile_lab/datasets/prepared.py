# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Features of labelled trials that are not bags of ours: selected, resampled, cropped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_classifier.datasets.archive import LabelledTrials
from tactile_classifier.datasets.dataset import ALL, Channel, FeatureTable, usable_table
from tactile_features.config import FeatureConfig
from tactile_features.extraction.extractor import features_from_trials
from tactile_features.records import PHASE_GLIDE, PROTOCOL_TEXTURE
from tactile_lab.datasets.feature_options import choose_features
from tactile_lab.datasets.reread import count_samples
from tactile_lab.datasets.selection import select_trials
from tactile_lab.datasets.sources.leaves import Leaf
from tactile_lab.datasets.sources.load import load_trials
from tactile_lab.datasets.sources.questions import Questions
from tactile_lab.datasets.trial_options import TrialOptions
from tactile_ros.errors import TactileError


@dataclass(frozen=True)
class PreparedTrials:
    """Trials as their features see them.

    Attributes
    ----------
    title : str
        Task, source, channel, and what was done.
    trials : LabelledTrials
        Selected, resampled and cropped; those that gave features.
    channel : int, ``'all'`` or None
        As `table_from_trials` takes it.
    speeds_m_s : ndarray of shape (trials,) or None
    """

    title: str
    task: str
    trials: LabelledTrials
    channel: Channel
    config: FeatureConfig
    speeds_m_s: NDArray[np.float64] | None
    table: FeatureTable

    def compute_table(self, fields: Mapping[str, Any]) -> FeatureTable:
        """Return other features of the same trials, by fields of `FeatureConfig`."""
        config = replace(self.config, **fields)
        table, trials = usable_table(
            self.task, self.trials, self.channel, config=config, speeds_m_s=self.speeds_m_s
        )
        return _name_trials(table, trials)

    def partial_tables(
        self, table: FeatureTable, seconds: Sequence[float]
    ) -> dict[int, FeatureTable]:
        """Return features of the first parts of each trial, by samples.

        Raises
        ------
        TactileError
            When ``seconds`` do not fit into the trials.
        """
        trials = self.trials
        samples = trials.x.shape[2]
        longest_s = max(self.config.buffer_s, 1.0 + samples / trials.rate_hz)
        config = replace(
            self.config, rate_hz=trials.rate_hz, texture_samples=samples, buffer_s=longest_s
        )
        channels = range(trials.x.shape[1]) if self.channel == ALL else [self.channel]

        def compute(count: int) -> NDArray[np.float64]:
            parts = [
                features_from_trials(
                    self.task,
                    trials.signal(channel),
                    trials.rate_hz,
                    first_samples=count,
                    config=self.config,
                )[0]
                for channel in channels
            ]
            return np.hstack(parts)

        counts = count_samples(seconds, config)
        return {count: replace(table, values=compute(count)) for count in counts}


def prepare_trials(leaves: Sequence[Leaf], options: TrialOptions, *, folds: int) -> PreparedTrials:
    """Read trials and compute their features.

    Parameters
    ----------
    leaves : sequence of Leaf
        From `split_sources`.
    options : TrialOptions
        With a task.
    folds : int
        Fewer trials than this are refused.

    Raises
    ------
    TactileError, DatasetError
        With a sentence, when options and recordings do not fit.
    """
    name = leaves[0].root.name or str(leaves[0].root)
    if options.task is None:
        raise TactileError(f'say what {name} is about: --task texture or --task stiffness')
    channel = _parse_channel(options.channel or '0')
    config = FeatureConfig(**choose_features(options.over, options.detrend, options.features))
    trials = load_trials(
        leaves, options.sources, Questions(), folds=folds, skip_bad=options.skip_bad
    )
    names: dict[Channel, str] = {None: 'mean of all channels', ALL: 'all channels'}
    title = [options.task, name, names.get(channel, f'channel {channel}')]
    if options.where is not None:
        trials = trials.take(select_trials(trials.columns, options.where, 'where'))
        title.append(options.where)
    trials = options.train_test.keep(trials)
    if options.resample_hz is not None:
        trials = trials.resample(options.resample_hz)
        title.append(f'at {options.resample_hz:g} Hz')
    if options.crop is not None:
        start_s, stop_s = _parse_span(options.crop)
        trials = trials.between(start_s, stop_s)
        title.append(f'{start_s:g} to {stop_s:g} s')
    speeds_m_s = None
    if options.over:
        title.append(f'over {options.over} mm')
    is_texture_with_speed = options.task == PROTOCOL_TEXTURE and options.speed_column
    needs_speed = options.over or config.feature_set(PHASE_GLIDE).needs_speed
    if needs_speed or is_texture_with_speed:
        speeds_m_s = _speeds_m_s(options, trials)
    table, trials = usable_table(
        options.task, trials, channel, config=config, speeds_m_s=speeds_m_s
    )
    if speeds_m_s is not None:
        speeds_m_s = _speeds_m_s(options, trials)  # of those that are left
    table = _name_trials(table, trials)
    return PreparedTrials(
        ', '.join(title), options.task, trials, channel, config, speeds_m_s, table
    )


def _name_trials(table: FeatureTable, trials: LabelledTrials) -> FeatureTable:
    """Return the table with a column ``trial_id``."""
    if 'trial_id' in table.columns:
        return table
    rows = trials.columns.get('trial', trials.rows).astype(str)
    return replace(table, columns={**table.columns, 'trial_id': rows})


def _speeds_m_s(options: TrialOptions, trials: LabelledTrials) -> NDArray[np.float64]:
    """Return the sliding speed of each trial, in the unit that its column's name says."""
    if options.task != PROTOCOL_TEXTURE:
        raise TactileError('features over the surface are for texture; a hold goes nowhere')
    name = options.speed_column
    if name is None or name not in trials.columns or trials.columns[name].dtype.kind not in 'fiu':
        raise TactileError(
            'name the column with the sliding speeds as numbers, as in --speed-column '
            f'speed_mm_s; there are: {", ".join(trials.columns) or "none"}'
        )
    for ending, unit_m_s in (('_mm_s', 1e-3), ('_m_s', 1.0)):
        if name.endswith(ending):
            return trials.columns[name].astype(np.float64) * unit_m_s
    raise TactileError(f'--speed-column: the name "{name}" must end in its unit, _mm_s or _m_s')


def _parse_channel(text: str) -> Channel:
    """Return the number of a channel, ``all``, or None for ``mean``."""
    if text == 'mean':
        return None
    if text == ALL:
        return ALL
    if not text.isdecimal():
        raise TactileError(f'--channel is "{text}"; it must be a number from 0, "mean" or "all"')
    return int(text)


def _parse_span(text: str) -> tuple[float, float]:
    """Return start and stop in seconds from ``START:STOP``."""
    start, _, stop = text.partition(':')
    try:
        span = float(start), float(stop)
    except ValueError as error:
        raise TactileError(f'"{text}" is not START:STOP in seconds, as in 1:5') from error
    if not 0 <= span[0] < span[1] < float('inf'):
        raise TactileError(f'"{text}": START must be 0 or more and less than STOP')
    return span
