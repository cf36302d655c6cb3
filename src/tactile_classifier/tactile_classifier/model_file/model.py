# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Loaded model files: checks, and classification of windows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import contextlib
import dataclasses
from functools import cached_property
import hashlib
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactile_classifier.confidence.held_out_novelty import HeldOutNovelty
from tactile_classifier.errors import DatasetError, ModelFileError
from tactile_classifier.model_file.manifest import read_known_novelty
from tactile_classifier.model_file.prediction import Predictions
from tactile_classifier.model_file.samples import SampleWindow
from tactile_classifier.model_file.storage import open_model
from tactile_classifier.types import (
    NO_ANSWER,
    PredictionOutcome,
    PROBABILITY,
    UNKNOWN,
    WindowPrediction,
)
from tactile_features.errors import FeatureError, UndefinedFeatureError
from tactile_features.feature_sets.registry import find_feature_set
from tactile_features.model_container import read_limited
from tactile_features.model_contract import refusals_of
from tactile_features.spec import FeatureSpec, format_rates, is_same_rate
from tactile_features.types import contacts_agree, FeatureWindow, WindowOutcome

_REMEDY = 'name its file in the parameter models of the feature node, or train it again'


@dataclasses.dataclass(frozen=True)
class Prediction:
    """Result of a model for one window of samples.

    Attributes
    ----------
    label : str
        A label of the model, ``'unknown'`` (unlike all training trials) or ``'no answer'``.
    reason : str or None
        One sentence if the label is ``'unknown'`` or ``'no answer'``; otherwise None.
    probabilities : mapping of str to float
        Probability of each label, calibrated on held-out trials. Empty if the model is not
        calibrated, or if the label is ``'no answer'``.
    scores : mapping of str to float
        Score of each label; a higher score means a more likely label. If the model is calibrated,
        the scores equal ``probabilities``. Empty if the label is ``'no answer'``.
    novelty, novelty_threshold : float or None
        Distance to the training trials [1]. If it exceeds the threshold, the window is unknown.
        None if the model has no novelty measure, or if the label is ``'no answer'``.
    p_value : float or None
        Fraction of held-out trials of known labels that are at least as novel as this window [1].
        A small value means that the window is unlike the training trials.

    A model that was trained on too few trials has no probabilities and no novelty. The reason is
    in ``manifest.calibration['reason']`` of the model.
    """

    label: str
    reason: str | None
    probabilities: Mapping[str, float] = dataclasses.field(default_factory=dict)
    scores: Mapping[str, float] = dataclasses.field(default_factory=dict)
    novelty: float | None = None
    novelty_threshold: float | None = None
    p_value: float | None = None


_OUTCOMES = {UNKNOWN: PredictionOutcome.UNKNOWN, NO_ANSWER: PredictionOutcome.NO_FEATURES}


def load_model(path: str | Path) -> TactileModel:
    """Read and check a model file.

    Raises
    ------
    ModelFileError
        If the file cannot be used; the message gives the reason.
    """
    with refusals_of(path):
        return TactileModel(read_limited(Path(path)), str(Path(path).resolve()))


class TactileModel:
    """A trained classifier; use `load_model` to read it from a file.

    >>> model = load_model('texture.npz')
    >>> answer = model.classify(tension_n, rate_hz=60)
    >>> answer.label, answer.probabilities, answer.p_value
    >>> model.predict_or_unknown(windows_n)

    Parameters
    ----------
    data : bytes
        Contents of the model file.
    path : str
        Path of the file; empty if the model is not stored in a file.

    Attributes
    ----------
    sha256 : str
        Digest of the file, in hexadecimal digits.
    manifest : Manifest
    card : str
        Description of the model as text.
    spec : FeatureSpec
        Specification of the features.
    labels : tuple of str
        Labels, in the order of the scores.
    model_id : str
        Task, contact, classifier and the first 12 digits of ``sha256``.
    predictor : Predictor
        Scaling, classifier, calibration and novelty measure.
    """

    def __init__(self, data: bytes, path: str = '') -> None:
        self.path = path
        self.sha256 = hashlib.sha256(data).hexdigest()
        contents = open_model(data)
        self.manifest, self.card = contents.manifest, contents.card
        self.spec: FeatureSpec = self.manifest.spec
        self.labels = self.manifest.labels
        self.model_id = '-'.join(
            (
                self.manifest.task,
                self.manifest.contact or 'any',
                self.manifest.classifier,
                self.sha256[:12],
            )
        )
        self._announced: Mapping[str, FeatureSpec] = {}
        self._known_novelty: HeldOutNovelty | None = read_known_novelty(self.manifest)
        self.predictor = contents.predictor

    @property
    def task(self) -> str:
        return self.manifest.task

    @property
    def contact(self) -> str:
        return self.manifest.contact

    def check_fits(self, spec: FeatureSpec) -> None:
        """Raise ModelFileError if ``spec`` differs from the specification of the training."""
        reason = self.spec.mismatch(spec)
        if reason is not None:
            raise ModelFileError(f'model {self.model_id} was trained on other features: {reason}')

    def set_specifications(self, specs: Iterable[FeatureSpec]) -> None:
        """Store the specifications that the feature node announced for future windows.

        The announced specifications decide which windows fit the model (`fits`):

        - If the specification of the model is complete, windows fit if their digest is that of the
          model, or if their announced specification differs only in the rate, by less than
          `SAME_RATE`.
        - If the model was trained on windows that were already cut, its specification does not
          contain the position of the window within the phase. Windows then fit if their announced
          specification agrees in everything else. Before the first announcement, all windows fit.
        """
        self._announced = {spec.digest: spec for spec in specs}

    def fits(self, digest: str) -> bool:
        """Return True if windows whose specification has this digest fit the model.

        See `set_specifications`.
        """
        if digest == self.spec.digest:
            return True
        if not self._announced:
            return bool(self.spec.missing_parameters)
        announced = self._announced.get(digest)
        return announced is not None and self.spec.mismatch(announced) is None

    def compute(self, values: npt.ArrayLike) -> Predictions:
        """Return the predictions for many windows.

        Parameters
        ----------
        values : array_like of shape (windows, k)
            Features in the order and units of ``spec``.

        Raises
        ------
        DatasetError
            If the values have another shape.
        """
        rows = np.asarray(values, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != len(self.spec.names):
            remedy = '; one window is values[np.newaxis]' if rows.ndim == 1 else ''
            raise DatasetError(
                f'the values have shape {rows.shape}; model {self.model_id} takes '
                f'(windows, {len(self.spec.names)}){remedy}'
            )
        if not len(rows):
            none = np.empty((0, len(self.labels)))
            return Predictions(np.empty(0, dtype=np.intp), none, np.empty(0))
        return self.predictor.compute(np.ascontiguousarray(rows))

    def classify(
        self, samples: npt.ArrayLike, rate_hz: float, *, speed_m_s: float = 0.0, cut: bool = False
    ) -> Prediction:
        """Classify one window of samples, with the same result as the live classifier.

        Parameters
        ----------
        samples : array_like of shape (n,)
            Tension at evenly spaced times, in the unit of the training [N]. Pass the same part of
            a trial as in training. It has ``spec.sample_count`` samples; if this is 0, any
            length is allowed. If the model was trained on recordings with several channels, pass
            all channels, shape (channels, n). If it uses only one of them, ``spec.channel``, this
            channel can be passed instead.
        rate_hz : float
            Sample rate [Hz]; must equal ``spec.rate_hz`` within 0.1 %.
        speed_m_s : float
            Sliding speed, for features that need it [m/s].
        cut : bool
            Cut the window out of a longer signal, as in training. If the model contains the start
            time of the window, the window begins there; otherwise, it begins at the first sample.
            For feature sets over distance, the window is in the middle of the signal.

        Raises
        ------
        DatasetError
            If shape, length, rate or speed do not fit the model; the message gives the remedy.
        ModelFileError
            If this installation cannot compute the features that the model was trained on.
        """
        try:
            values = self._samples.compute(samples, rate_hz, speed_m_s, cut=cut)
        except UndefinedFeatureError as error:
            return Prediction(NO_ANSWER, str(error))
        except DatasetError as error:
            raise DatasetError(f'model {self.model_id}: {error}') from error
        return self._add_p_value(self._judge(values))

    @cached_property
    def _samples(self) -> SampleWindow:
        try:
            return SampleWindow(self.task, self.spec)
        except FeatureError as error:
            raise ModelFileError(f'model {self.model_id} cannot be used: {error}') from error

    def compute_features(
        self, windows: npt.ArrayLike, speed_m_s: npt.ArrayLike = 0.0
    ) -> npt.NDArray[np.float64]:
        """Compute the features of windows of samples, shape (windows, k).

        If a window has no features, for example because a sample is missing, its row is NaN.

        Parameters
        ----------
        windows : array_like of shape (windows, n) or (windows, channels, n)
            Tension in the unit of the training [N], at the rate ``spec.rate_hz``. See `classify`.
        speed_m_s : float or array_like of shape (windows,)
            Sliding speed, for feature sets over distance [m/s]. They use the middle of each
            window.

        Raises
        ------
        DatasetError
            When shape, length or speed do not fit the model.
        ModelFileError
            When this installation cannot compute the features that the model was trained on.
        """
        each = np.asarray(windows, dtype=np.float64)
        if each.ndim < 2:
            raise DatasetError(
                f'the windows have shape {each.shape}; it must be (windows, samples); one window '
                'is windows[np.newaxis]'
            )
        rows = np.full((len(each), len(self.spec.names)), np.nan)
        speeds = np.broadcast_to(np.asarray(speed_m_s, dtype=np.float64), len(each)).tolist()
        rate_hz, cut = self.spec.rate_hz, self._samples.needs_speed
        try:
            for row, window, speed in zip(rows, each, speeds, strict=True):
                with contextlib.suppress(UndefinedFeatureError):
                    row[:] = self._samples.compute(window, rate_hz, speed, cut=cut)
        except DatasetError as error:
            raise DatasetError(f'model {self.model_id}: {error}') from error
        return rows

    def predict(
        self, windows: npt.ArrayLike, *, speed_m_s: npt.ArrayLike | None = None
    ) -> npt.NDArray[np.str_]:
        """Return the most likely label of each window, even if the object may be unknown.

        Parameters
        ----------
        windows : array_like of shape (windows, k) or (windows, n)
            Rows of features in the order and units of ``spec``, or windows of samples as in
            `compute_features`. If rows have ``k = len(spec.names)`` values and ``speed_m_s`` is
            omitted, they are features.
        speed_m_s : float or array_like of shape (windows,), optional
            Sliding speed of windows of samples, for features over distance [m/s].

        Raises
        ------
        DatasetError
            When the shape fits neither the features nor the windows of the model, or when a window
            has no features (`predict_or_unknown` marks such windows instead).
        """
        return np.array(self.labels)[self._predict_all(windows, speed_m_s).answer]

    def predict_or_unknown(
        self, windows: npt.ArrayLike, *, speed_m_s: npt.ArrayLike | None = None
    ) -> npt.NDArray[np.str_]:
        """Return a label for each window, or ``'unknown'`` or ``'no answer'``.

        ``'unknown'`` means that the window is unlike all training trials; ``'no answer'`` means
        that it has no features. The parameters are the same as in `predict`. Raises DatasetError
        when the shape is wrong.
        """
        found = self.compute(self._read(windows, speed_m_s))
        names = np.array(self.labels, dtype=object)[found.answer]
        threshold = self.manifest.confidence.novelty_threshold
        if len(found.novelty) and threshold >= 0.0:
            names[found.novelty > threshold] = UNKNOWN
        names[~_are_finite(found)] = NO_ANSWER
        return names.astype(str)

    def predict_proba(
        self, windows: npt.ArrayLike, *, speed_m_s: npt.ArrayLike | None = None
    ) -> npt.NDArray[np.float64]:
        """Return the calibrated probability of each label [1], shape (windows, labels).

        The columns are in the order of ``labels``. Parameters and errors are the same as in
        `predict`. In addition, raises DatasetError when the model has no calibration.
        """
        if self.manifest.score_kind != PROBABILITY:
            raise DatasetError(
                f'model {self.model_id} has no calibrated probabilities: {self._why_raw}'
            )
        return self._predict_all(windows, speed_m_s).scores

    def novelty(
        self, windows: npt.ArrayLike, *, speed_m_s: npt.ArrayLike | None = None
    ) -> npt.NDArray[np.float64]:
        """Return the distance to the training trials [1], shape (windows,).

        If it exceeds ``manifest.confidence.novelty_threshold``, the window is unknown. Parameters
        and errors are the same as in `predict`. In addition, raises DatasetError when the model
        has no novelty measure.
        """
        if self.predictor.novelty is None:
            raise DatasetError(f'model {self.model_id} has no novelty measure: {self._why_raw}')
        return self._predict_all(windows, speed_m_s).novelty

    def p_value(
        self, windows: npt.ArrayLike, *, speed_m_s: npt.ArrayLike | None = None
    ) -> npt.NDArray[np.float64]:
        """Return the fraction of held-out trials that are at least as novel [1], shape (windows,).

        A small value means that the window is unlike the training trials. Parameters and errors
        are the same as in `novelty`.
        """
        novelty = self.novelty(windows, speed_m_s=speed_m_s)
        return np.array([self._compute_p_value(each) for each in novelty.tolist()])

    @property
    def _why_raw(self) -> str:
        return str(self.manifest.calibration.get('reason', 'train it again'))

    def _compute_p_value(self, novelty: float) -> float:
        assert self._known_novelty is not None  # the file has novelties of held-out trials
        strict = self.manifest.calibration.get('strict') is True
        return self._known_novelty.compute_p_value(novelty, strict=strict)

    def _read(
        self, windows: npt.ArrayLike, speed_m_s: npt.ArrayLike | None
    ) -> npt.NDArray[np.float64]:
        """Return rows of features for the argument of `predict`.

        If ``windows`` are samples, their features are computed.
        """
        rows = np.asarray(windows, dtype=np.float64)
        found = find_feature_set(self.spec.feature_set)
        needs_speed = found is not None and found.needs_speed
        is_of_features = rows.ndim < 2 or rows.shape[1:] == (len(self.spec.names),)
        if speed_m_s is None and (is_of_features or needs_speed):
            return rows
        try:
            return self.compute_features(rows, 0.0 if speed_m_s is None else speed_m_s)
        except DatasetError as error:
            raise DatasetError(
                f'{error}; rows of features have shape (windows, {len(self.spec.names)})'
            ) from error

    def _predict_all(self, windows: npt.ArrayLike, speed_m_s: npt.ArrayLike | None) -> Predictions:
        """Return the predictions; raise DatasetError when a window has no prediction."""
        found = self.compute(self._read(windows, speed_m_s))
        without = np.flatnonzero(~_are_finite(found))
        if len(without):
            raise DatasetError(
                f'window {without[0]} has no finite features or scores; predict_or_unknown marks '
                f'such windows as "{NO_ANSWER}"'
            )
        return found

    def accepts(self, window: FeatureWindow) -> bool:
        """Return True if feature set and contact of the window fit the model."""
        is_of_set = window.feature_set == self.spec.feature_set
        return is_of_set and contacts_agree(self.contact, window.contact)

    def classify_window(self, window: FeatureWindow) -> WindowPrediction:
        """Classify one window of features; the result contains the reason if there is no label.

        If the novelty of the window is above the threshold, the result is unknown.
        """
        found = self._judge_window(window)
        outcome = _OUTCOMES.get(found.label, PredictionOutcome.LABEL)
        return WindowPrediction(
            task=self.manifest.task,
            trial_id=window.trial_id,
            contact=window.contact,
            model_id=self.model_id,
            simulated=window.simulated or self.manifest.simulated,
            outcome=outcome,
            label=found.label if outcome == PredictionOutcome.LABEL else '',
            reason=found.reason or '',
            labels=self.labels,
            scores=tuple(found.scores.values()),
            score_kind=self.manifest.score_kind,
            novelty=-1.0 if found.novelty is None else found.novelty,
            novelty_threshold=self.manifest.confidence.novelty_threshold,
            window_start_ns=window.window_start_ns,
            window_end_ns=window.window_end_ns,
            frame_id=window.frame_id,
            false_alarm_rate=self.manifest.false_alarm_rate,
        )

    def answer(self, window: FeatureWindow) -> Prediction:
        """Like `classify_window`, but returns the same type as `classify`."""
        return self._add_p_value(self._judge_window(window))

    def _judge_window(self, window: FeatureWindow) -> Prediction:
        reason = self._find_obstacle(window)
        return self._judge(window.values) if reason is None else Prediction(NO_ANSWER, reason)

    def _judge(self, values: npt.NDArray[np.float64]) -> Prediction:
        """Classify the features of one window, shape (k,); the result has no p-value."""
        found = self.compute(values[np.newaxis])
        if not _are_finite(found)[0]:
            return Prediction(NO_ANSWER, 'the scores of these features are not finite')
        label = self.labels[int(found.answer[0])]
        reason: str | None = None
        scores = dict(zip(self.labels, found.scores[0].tolist(), strict=True))
        probabilities = scores if self.manifest.score_kind == PROBABILITY else {}
        if not len(found.novelty):
            return Prediction(label, reason, probabilities, scores)
        novelty = float(found.novelty[0])
        threshold = self.manifest.confidence.novelty_threshold
        if novelty > threshold:
            label = UNKNOWN
            reason = (
                f'unlike all training trials: novelty {novelty:.3g} exceeds the threshold '
                f'{threshold:.3g}'
            )
        return Prediction(label, reason, probabilities, scores, novelty, threshold)

    def _add_p_value(self, found: Prediction) -> Prediction:
        """Return the prediction with its p-value, which a node does not need."""
        if found.novelty is None:
            return found
        return dataclasses.replace(found, p_value=self._compute_p_value(found.novelty))

    def _find_obstacle(self, window: FeatureWindow) -> str | None:
        """Return why a window cannot be classified, or None."""
        if window.outcome != WindowOutcome.OK:
            return window.reason or f'the window ended with {WindowOutcome(window.outcome).name}'
        reason = self.find_mismatch(window)
        if reason is None and not np.isfinite(window.values).all():
            return 'the features are not finite'
        return reason

    def find_mismatch(self, window: FeatureWindow) -> str | None:
        """Return how the specification of a window differs from the model, or None if it fits.

        If only the digest differs and the specification of the window was announced, the text
        describes the difference. If it was not announced, the text lists all parameters of the
        model.
        """
        spec = self.spec
        pairs = [
            ('feature set', window.feature_set, spec.feature_set),
            ('version of the feature set', window.feature_set_version, spec.version),
        ]
        if not is_same_rate(window.rate_hz, spec.rate_hz):
            pairs.append(('rate in Hz', *format_rates(window.rate_hz, spec.rate_hz)))
        if window.outcome == WindowOutcome.OK:
            if spec.sample_count:
                pairs.append(('window in samples', window.sample_count, spec.sample_count))
            pairs.append(('number of features', len(window.values), len(spec.names)))
        for what, got, wanted in pairs:
            if got != wanted:
                return f'the {what} is {got}; the model was trained on {wanted}: {_REMEDY}'
        digest = window.specification_digest
        if self.fits(digest):
            return None
        if digest in self._announced and (reason := spec.mismatch(self._announced[digest])):
            return f'{reason}; {_REMEDY}'
        values = ', '.join(
            f'{name} {value if isinstance(value, str) else format(value, "g")}'
            for name, value in sorted(spec.parameters.items())
        )
        return (
            'the features have another specification than in training '
            f'(digest {digest} instead of {spec.digest}, with {values}): {_REMEDY}'
        )


def _are_finite(found: Predictions) -> npt.NDArray[np.bool_]:
    """Return which windows have finite scores and, if there are novelties, a finite novelty."""
    finite = np.isfinite(found.scores).all(axis=1)
    return np.asarray(finite & np.isfinite(found.novelty) if len(found.novelty) else finite)
