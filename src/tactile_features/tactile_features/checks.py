# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Check that a feature set keeps the contract of `FeatureSet`, for tests of your own sets."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError, UndefinedFeatureError
from tactile_features.feature_sets.feature_set import (
    FeatureSet,
    WindowParameters,
    WindowSamples,
)
from tactile_features.feature_sets.registry import CHOOSER

FloatArray = NDArray[np.float64]

SAMPLES = 180
"""Number of samples in a window if neither the feature set nor the speed determines it."""

SPEED_M_S = 0.015
"""Sliding speed of the windows [m/s]."""

BATCHES = (1, 6, 129, 481)
"""Numbers of windows in a batch; linear algebra uses other algorithms for large batches."""


class FeatureSetCheckError(FeatureError):
    """A feature set breaks the contract of `FeatureSet`.

    Attributes
    ----------
    code : str
        The check that failed: ``attributes``, ``names``, ``window``, ``shape``, ``finite``,
        ``input``, ``repeatable``, ``batch`` or ``undefined``.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code


def check_feature_set(
    feature_set: type[FeatureSet],
    config: WindowParameters | None = None,
    windows: FloatArray | None = None,
) -> None:
    """Check that a feature set fulfils the contract of `FeatureSet`.

    The following is checked:

    - The attributes are valid, and the names of the features are distinct.
    - `compute` returns one finite float64 for each name, and does not change its input.
    - A window gives the same bits by itself as at any place in a batch.
    - If windows have no value, the error lists all of them.

    The check does not show whether the values are correct.

    Parameters
    ----------
    feature_set : subclass of FeatureSet
    config : FeatureConfig, optional
        Parameters of the feature set; defaults if omitted.
    windows : ndarray of shape (m, n), optional
        Further windows to compute [N]. If the windows of the feature set have a fixed number of
        samples, n must be this number.

    Raises
    ------
    FeatureSetCheckError
        The message describes the error; ``code`` is the name of the check.
    """
    _check_attributes(feature_set)
    bound = feature_set(FeatureConfig() if config is None else config)
    spec = bound.window(bound.config.rate_hz, _speed_of(bound))
    lengths = (spec.crop_start_s, spec.crop_end_s, spec.shortest_s, spec.sample_count)
    _require(
        bound,
        all(np.isfinite(length) and length >= 0 for length in lengths),
        'window',
        f'window() returned {spec}; its values must be finite and not negative',
    )
    features = _check_names(bound)
    count = spec.sample_count or SAMPLES
    _check_repeatable(bound, _make_windows(6, count))
    # If the features need the speed, windows are computed one by one, never in large batches.
    sizes = BATCHES[:2] if feature_set.needs_speed else BATCHES
    batches = [_make_windows(rows, count) for rows in sizes]
    if windows is not None:
        batches.append(np.array(windows, dtype=np.float64))
    for batch in batches:
        _check_values(bound, batch, features)
    _check_undefined(bound, _make_windows(5, count))


def _require(
    feature_set: FeatureSet | type[FeatureSet], is_kept: bool, code: str, message: str
) -> None:
    if not is_kept:
        raise FeatureSetCheckError(code, f'{getattr(feature_set, "name", feature_set)}: {message}')


def _check_attributes(feature_set: type[FeatureSet]) -> None:
    for attribute, kind in (('name', str), ('version', int), ('phase', str)):
        value = getattr(feature_set, attribute, None)
        _require(
            feature_set,
            isinstance(value, kind),
            'attributes',
            f'the class attribute {attribute} is {value!r}; set it to a {kind.__name__}',
        )
    _require(
        feature_set,
        feature_set.phase in CHOOSER,
        'attributes',
        f'phase is "{feature_set.phase}"; it must be {" or ".join(CHOOSER)}',
    )
    known = {field.name for field in fields(WindowParameters)}
    counted = (feature_set.count_field,) if feature_set.count_field else ()
    unknown = {*feature_set.cut, *feature_set.options, *counted} - known
    _require(
        feature_set,
        not unknown,
        'attributes',
        'cut, options and count_field must name fields of FeatureConfig that feature sets can '
        f'read; {", ".join(sorted(unknown))} is not such a field',
    )
    _require(
        feature_set,
        bool(counted) or not feature_set.can_be_early,
        'attributes',
        'can_be_early needs count_field: early windows have a fixed number of samples',
    )


def _check_names(bound: FeatureSet) -> int:
    """Check the names and units of the features; return the number of features."""
    given = bound.sample_count, bound.config.rate_hz
    described = bound.describe(*given)
    names = {feature.name for feature in described}
    is_text = all(isinstance(part, str) and part for feature in described for part in feature)
    is_same = described == type(bound)(bound.config).describe(*given)
    _require(
        bound,
        bool(names) and is_text and len(names) == len(described) and is_same,
        'names',
        'describe() must return distinct names with units, and the same at each call',
    )
    return len(names)


def _speed_of(bound: FeatureSet) -> float:
    return SPEED_M_S if bound.needs_speed else 0.0


def _compute(bound: FeatureSet, tension_n: FloatArray) -> FloatArray:
    count, rate_hz = tension_n.shape[-1], bound.config.rate_hz
    jitter = np.random.default_rng(count).uniform(-0.1, 0.1, count)
    time_ns = np.rint((np.arange(count) + jitter) * (1e9 / rate_hz)).astype(np.int64)
    return bound.compute(WindowSamples(time_ns, tension_n, rate_hz, _speed_of(bound)))


def _have_same_bits(one: FloatArray, other: FloatArray) -> bool:
    return one.shape == other.shape and one.tobytes() == other.tobytes()


def _check_repeatable(bound: FeatureSet, batch: FloatArray) -> None:
    first, *others = (
        _compute(each, batch.copy()) for each in (bound, bound, type(bound)(bound.config))
    )
    _require(
        bound,
        all(_have_same_bits(first, each) for each in others),
        'repeatable',
        'compute() returned other bits when it was called again; it must not depend on earlier '
        'calls',
    )


def _check_values(bound: FeatureSet, batch: FloatArray, features: int) -> None:
    """Check the features of a batch, and compare them with those of parts of the batch."""
    before = batch.copy()
    values = _compute(bound, batch)
    _require(
        bound,
        values.dtype == np.float64 and values.shape == (len(batch), features),
        'shape',
        f'compute() returned {values.dtype} of shape {values.shape} for {len(batch)} windows and '
        f'{features} names; return float64 of shape {(len(batch), features)}',
    )
    _require(
        bound,
        bool(np.isfinite(values).all()),
        'finite',
        'compute() returned values that are not finite; raise UndefinedFeatureError for windows '
        'without a value',
    )
    _require(
        bound,
        np.array_equal(batch, before) and not np.shares_memory(values, batch),
        'input',
        'compute() changed or returned its input; work on a copy',
    )
    last = len(batch) - 1
    parts = (last, slice(1), slice(last, None), slice(last // 3, last // 3 + 20))
    _require(
        bound,
        all(_have_same_bits(_compute(bound, batch[part].copy()), values[part]) for part in parts),
        'batch',
        f'a window gives other bits by itself than in a batch of {len(batch)} windows; use sums '
        'along the last axis instead of matrix products',
    )


def _check_undefined(bound: FeatureSet, batch: FloatArray) -> None:
    """Check that constant windows have values, or that the error lists all of them."""
    batch[1], batch[3] = 5.0, 0.0
    try:
        values = _compute(bound, batch)
    except UndefinedFeatureError as error:
        _require(
            bound,
            error.windows == (1, 3),
            'undefined',
            'windows 1 and 3 of a batch are constant, but UndefinedFeatureError.windows is '
            f'{error.windows}; it must contain the indices of all windows without a value',
        )
    else:
        _require(
            bound,
            bool(np.isfinite(values).all()),
            'undefined',
            'a constant window has values that are not finite; raise UndefinedFeatureError for it',
        )


def _make_windows(rows: int, count: int) -> FloatArray:
    """Return windows of a random walk at several offsets and scales [N]."""
    generator = np.random.default_rng(rows)
    walk = generator.standard_normal((rows, count)).cumsum(axis=1)
    walk *= np.array([1.0, 1e-3, 10.0])[np.arange(rows) % 3, None]
    walk += np.array([5.0, 0.0, 1e6])[np.arange(rows) % 3, None]
    return walk
