# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feature sets as scikit-learn transformers.

Each transformer takes windows that are already cut out of their phases. For the same samples, it
computes the same numbers as the feature node. No other module of this package imports
scikit-learn.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils import validation
from sklearn.utils.validation import check_is_fitted

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.extraction.extractor import features_from_trials
from tactile_features.feature_sets.registry import CHOOSER, find_feature_set, task_of
from tactile_features.spec import array_spec

FloatArray = NDArray[np.float64]

_Fitted = TypeVar('_Fitted', bound='FeatureTransformer')


def validate_data(estimator: Any, *arrays: Any, **options: Any) -> Any:
    """Check the arrays of ``fit`` or ``predict`` with any supported version of scikit-learn.

    The arguments and the errors are the same as in `sklearn.utils.validation.validate_data`.
    """
    if hasattr(validation, 'validate_data'):
        return validation.validate_data(estimator, *arrays, **options)
    return estimator._validate_data(*arrays, **options)  # noqa: SLF001 - before scikit-learn 1.6


class FeatureTransformer(TransformerMixin, BaseEstimator):
    """Base class of the transformers.

    To use a feature set of another package in a pipeline, derive a class from this one, and set
    ``feature_set`` to the name of the feature set. If ``options`` are added, the constructor must
    store them, in addition to ``rate_hz``.

    Parameters
    ----------
    rate_hz : float
        Sample rate of the windows [Hz].

    Attributes
    ----------
    feature_set : str
        Name of a registered feature set.
    options : mapping of str to str
        Maps each parameter of the constructor to the field of `FeatureConfig` that it sets.
    specification_ : FeatureSpec
        Names, units and options of the features, after ``fit``.
    n_features_in_ : int
        Columns of ``X`` in ``fit``.
    """

    feature_set: ClassVar[str]
    options: ClassVar[Mapping[str, str]] = MappingProxyType({})

    def __init__(self, rate_hz: float = 60.0) -> None:
        self.rate_hz = rate_hz

    def fit(self: _Fitted, X: ArrayLike, y: Any = None) -> _Fitted:  # noqa: N803
        """Check the parameters, and store the specification of the features.

        Parameters
        ----------
        X : array_like of shape (windows, samples)
            Tension [N].
        y : None
            Ignored.

        Returns
        -------
        FeatureTransformer
            This object.

        Raises
        ------
        ValueError
            When a parameter or the shape is invalid, or a value is not finite.
        """
        del y
        rows = validate_data(self, X, dtype=np.float64, ensure_min_features=2)
        with _as_value_error():
            windows, _ = self.split(rows)
            self.specification_ = array_spec(
                self.task, windows.shape[1], self.rate_hz, self._make_config()
            )
        return self

    def transform(self, X: ArrayLike) -> FloatArray:  # noqa: N803
        """Return the features of windows.

        Parameters
        ----------
        X : array_like of shape (windows, samples)
            Tension [N].

        Returns
        -------
        ndarray of shape (windows, features)
            Features in the order of `get_feature_names_out`. Their units are in
            ``specification_.units``.

        Raises
        ------
        ValueError
            When the number of columns differs from ``fit``, a value is not finite, or a feature
            of a window is undefined. For an undefined feature, the message has the number of the
            window.
        """
        check_is_fitted(self)
        rows = validate_data(self, X, dtype=np.float64, reset=False)
        with _as_value_error():
            windows, speeds_m_s = self.split(rows)
            return features_from_trials(
                self.task,
                windows,
                self.rate_hz,
                config=self._make_config(),
                speeds_m_s=speeds_m_s,
            )[0]

    def get_feature_names_out(self, input_features: Any = None) -> NDArray[Any]:
        """Return the names of the features, an array of str objects of shape (features,).

        If ``input_features`` is given, it must equal the column names of ``X`` in ``fit``.
        """
        check_is_fitted(self)
        validation._check_feature_names_in(self, input_features)  # noqa: SLF001
        return np.array(self.specification_.names, dtype=object)

    @property
    def task(self) -> str:
        """``texture`` or ``stiffness``."""
        return task_of(self.feature_set)

    def split(self, rows: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the windows in the rows of ``X`` [N], and their sliding speeds [m/s] or None."""
        return rows, None

    def _make_config(self) -> FeatureConfig:
        found = find_feature_set(self.feature_set)
        if found is None:
            raise FeatureError(f'the feature set "{self.feature_set}" is not installed')
        fields = {field: getattr(self, name) for name, field in self.options.items()}
        return FeatureConfig(**{CHOOSER[found.phase]: self.feature_set, **fields})


class TextureSpectrum(FeatureTransformer):
    """Single-sided amplitude spectrum of windows of a glide.

    ``detrend='mean'`` gives the features of the paper; see `compute_spectrum`.

    Parameters
    ----------
    rate_hz : float
        Sample rate of the windows [Hz].
    detrend : {'linear', 'mean', 'none'}
        Trend to subtract before the transform: the least-squares line, or the mean.
    window : {'none', 'hann'}
        Window function applied before the transform.

    Examples
    --------
    >>> import numpy as np
    >>> from tactile_features.estimators import TextureSpectrum
    >>> time_s = np.arange(180) / 60
    >>> X = 3.0 + 0.05 * np.sin(2 * np.pi * 4.0 * time_s)[np.newaxis]
    >>> transformer = TextureSpectrum(rate_hz=60.0, detrend='mean').fit(X)
    >>> amplitudes_n = transformer.transform(X)
    >>> amplitudes_n.shape, str(transformer.get_feature_names_out()[amplitudes_n[0].argmax()])
    ((1, 91), 'tension__spectrum__hz_4.000')
    """

    feature_set = 'texture_spectrum'
    options = MappingProxyType({'detrend': 'spectrum_detrend', 'window': 'spectrum_window'})

    def __init__(
        self, rate_hz: float = 60.0, detrend: str = 'linear', window: str = 'none'
    ) -> None:
        self.rate_hz = rate_hz
        self.detrend = detrend
        self.window = window


class StiffnessRegression(FeatureTransformer):
    """Slope [N/s], intercept [N] and correlation [1] of windows of a hold, against time.

    As in the paper; see `compute_regression`.

    Parameters
    ----------
    rate_hz : float
        Sample rate of the windows [Hz].

    Examples
    --------
    >>> import numpy as np
    >>> from tactile_features.estimators import StiffnessRegression
    >>> X = 5.0 - 0.2 * np.arange(120)[np.newaxis] / 60
    >>> StiffnessRegression(rate_hz=60.0).fit_transform(X).round(6).tolist()
    [[-0.2, 5.0, -1.0]]
    """

    feature_set = 'stiffness_regression'


class StiffnessRelaxation(FeatureTransformer):
    """The features of `StiffnessRegression`, and the ratio of slope to intercept [1/s].

    The force of the press scales slope and intercept by the same factor. It does not change their
    ratio.

    Parameters
    ----------
    rate_hz : float
        Sample rate of the windows [Hz].
    """

    feature_set = 'stiffness_relaxation'


class GlideWaveform(FeatureTransformer):
    """The tension in windows of a glide [N], as the means of at most 600 equal parts.

    For classifiers of the shape, such as `tactile_classifier.RandomConvolutionClassifier`.

    Parameters
    ----------
    rate_hz : float
        Sample rate of the windows [Hz].
    """

    feature_set = 'glide_waveform'


class HoldWaveform(FeatureTransformer):
    """The tension in windows of a hold [N], as the means of at most 100 equal parts.

    Parameters
    ----------
    rate_hz : float
        Sample rate of the windows [Hz].
    """

    feature_set = 'hold_waveform'


class SpatialTransformer(FeatureTransformer):
    """Base class of the transformers over distance, which need the sliding speed of each window.

    All rows of ``X`` have the same number of samples. At some speeds, a window of ``length_m`` has
    fewer samples than its row. Then the middle of the row is used.
    """

    options = MappingProxyType({'length_m': 'spatial_length_m', 'finest_m': 'spatial_finest_m'})

    def __init__(
        self,
        rate_hz: float = 60.0,
        speed_column: int | None = -1,
        speed_m_s: float | None = None,
        length_m: float = 0.045,
        finest_m: float = 0.0005,
    ) -> None:
        self.rate_hz = rate_hz
        self.speed_column = speed_column
        self.speed_m_s = speed_m_s
        self.length_m = length_m
        self.finest_m = finest_m

    def split(self, rows: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the windows in the rows of ``X`` [N], and their sliding speeds [m/s]."""
        column = self.speed_column
        if (column is None) == (self.speed_m_s is None):
            raise ValueError(
                f'speed_column is {column} and speed_m_s is {self.speed_m_s}; exactly one of them '
                'must be None: state the column of X with the sliding speeds, or their common '
                'speed [m/s]'
            )
        if column is None:
            return rows, np.full(len(rows), self.speed_m_s, dtype=np.float64)
        if not -rows.shape[1] <= column < rows.shape[1]:
            raise ValueError(f'speed_column is {column}, but X has {rows.shape[1]} columns')
        return np.delete(rows, column, axis=1), rows[:, column]


class TextureSpatial(SpatialTransformer):
    """Texture features over distance [N], at any sliding speed; see `compute_spatial`.

    Parameters
    ----------
    rate_hz : float
        Sample rate of the windows [Hz].
    speed_column : int or None
        Column of ``X`` with the sliding speed of each window [m/s]; the other columns are the
        samples. None if all windows have the speed ``speed_m_s``.
    speed_m_s : float or None
        Sliding speed of all windows [m/s]; only with ``speed_column=None``.
    length_m : float
        Length of a window along the surface [m].
    finest_m : float
        Finest scale [m]; the distance between samples must not exceed it.

    Examples
    --------
    >>> import numpy as np
    >>> from tactile_features.estimators import TextureSpatial
    >>> windows_n = np.random.default_rng(0).normal(3.0, 0.01, (2, 260))
    >>> X = np.column_stack([windows_n, [0.015, 0.0115]])
    >>> TextureSpatial(rate_hz=60.0, speed_column=-1).fit_transform(X).shape
    (2, 188)
    """

    feature_set = 'texture_spatial'


class SpatialWaveform(SpatialTransformer):
    """The tension over a stretch of surface [N], smoothed over the finest scale.

    Parameters
    ----------
    rate_hz : float
        Sample rate of the windows [Hz].
    speed_column : int or None
        Column of ``X`` with the sliding speed of each window [m/s]; the other columns are the
        samples. None if all windows have the speed ``speed_m_s``.
    speed_m_s : float or None
        Sliding speed of all windows [m/s]; only with ``speed_column=None``.
    length_m : float
        Length of a window along the surface [m].
    finest_m : float
        Finest scale [m]; the distance between samples must not exceed it.
    """

    feature_set = 'spatial_waveform'


@contextmanager
def _as_value_error() -> Iterator[None]:
    """Raise a `ValueError`, as scikit-learn expects, instead of a `FeatureError`."""
    try:
        yield
    except FeatureError as error:
        raise ValueError(str(error)) from error
