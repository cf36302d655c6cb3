# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Samples of trials as one long table, a row a sample, as pandas and polars take it."""

from __future__ import annotations

from collections.abc import Sequence
import json
from typing import Any

import numpy as np
import pyarrow

from tactile_bags.sources.files import SourceError
from tactile_bags.sources.raw_trials import join_columns
from tactile_bags.sources.table_files import METADATA_KEY, ROLE, UNIT
from tactile_bags.trial import Trial

_FIRST = ('trial', 'label', 'session_id', 'mounting_id')


def build_long_table(trials: Sequence[tuple[Trial, str]], rate_hz: float | None) -> pyarrow.Table:
    """Return the table of some trials, each with its name; see `Recording.to_table`."""
    if not trials:
        raise SourceError('no trial counts, so there is nothing to write')
    signals = [trial.signal for trial, _ in trials]
    channels = {signal.channels for signal in signals}
    if len(channels) > 1:
        raise SourceError(f'the trials have different channels: {sorted(channels)[:2]}')
    if any(signal.time_s is None for signal in signals):
        raise SourceError(
            'the recordings have no times, so the sample rate is not known: --rate-hz'
        )
    counts = [signal.values.shape[1] for signal in signals]
    known = join_columns([({**t.columns, 'label': t.label}, name) for t, name in trials])
    names = [*(n for n in _FIRST if n in known), *(n for n in known if n not in _FIRST)]
    of_trial = [n for n in names if n in _FIRST]
    others = [n for n in names if n not in _FIRST]
    fields: list[pyarrow.Field] = []
    columns: list[Any] = []

    def add(name: str, column: Any, metadata: dict[bytes, bytes] | None = None) -> None:
        fields.append(pyarrow.field(name, column.type, metadata=metadata))
        columns.append(column)

    def repeat(name: str) -> Any:
        column = pyarrow.array(known[name].tolist()).dictionary_encode()
        rows = np.repeat(np.arange(len(trials)), counts)
        if not pyarrow.types.is_string(column.type.value_type):
            return column.dictionary_decode().take(pyarrow.array(rows))
        return pyarrow.DictionaryArray.from_arrays(
            column.indices.take(pyarrow.array(rows)), column.dictionary
        )

    for name in of_trial:
        add(name, repeat(name))
    add('time_s', pyarrow.array(np.concatenate([s.time_s for s in signals])), {UNIT: b's'})
    for i, channel in enumerate(signals[0].channels):
        name = f'{channel}_signal' if channel in (*known, 'time_s') else channel
        unit = signals[0].unit
        values = np.concatenate([signal.values[i] for signal in signals])
        stated = {ROLE: b'value', **({UNIT: unit.encode()} if unit else {})}
        add(name, pyarrow.array(values), stated)
    for name in others:
        add(name, repeat(name))
    stated_rate = {} if rate_hz is None else {'rate_hz': rate_hz}
    metadata = {METADATA_KEY: json.dumps(stated_rate).encode()}
    return pyarrow.table(columns, schema=pyarrow.schema(fields, metadata=metadata))
