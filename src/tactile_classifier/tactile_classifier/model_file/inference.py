# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A model file in use: checked when loaded, then one answer a window."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import hashlib
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import DatasetError, ModelFileError
from tactile_classifier.model_file.manifest import Manifest
from tactile_classifier.model_file.onnx_session import open_session
from tactile_classifier.records import ClassificationResult, Outcome
from tactile_features.model_contract import read_limited, refusals_of
from tactile_features.onnx_container import open_container
from tactile_features.records import contacts_agree, FeatureWindow
from tactile_features.records import Outcome as FeatureOutcome
from tactile_features.spec import FeatureSpec

ROWS_AT_ONCE = 64
BYTES_AT_ONCE = 16 * 2**20
"""Most windows in one run, and most of their number times the size of the file [byte]:
differences to all training trials take memory in proportion to both."""

INPUT, SAMPLES = 'features', 'samples'
ANSWER, SCORES, NOVELTY = 'answer', 'scores', 'novelty'

_REMEDY = 'name its file in the parameter models of the feature node, or train it again'


class Answers(NamedTuple):
    """Answers of a model on many windows of one length.

    Attributes
    ----------
    answer : ndarray of int, shape (windows,)
        Position of each answer among the labels: the first largest score before calibration.
    scores : ndarray of shape (windows, labels)
        Larger is likelier; what they are, the manifest's ``score_kind`` says.
    novelty : ndarray of shape (windows,)
        Empty when the model has no novelty.
    """

    answer: npt.NDArray[np.int64]
    scores: npt.NDArray[np.float64]
    novelty: npt.NDArray[np.float64]


class Correction(NamedTuple):
    """Correction of a session's features, by its known trials.

    Attributes
    ----------
    offset : ndarray of shape (k,)
        Taken off the features, in their units.
    novelty_threshold : float
        In place of the model's.
    trials : int
        Known trials behind it.
    """

    offset: npt.NDArray[np.float64]
    novelty_threshold: float
    trials: int


def read_model_card(path: str | Path) -> str:
    """Return the card of a model file, as text for people.

    Raises
    ------
    ModelFileError
        With a sentence that says why the file is not used.
    """
    with refusals_of(path):
        return open_container(read_limited(path)).card


def read_manifest(path: str | Path) -> Manifest:
    """Return the manifest of a model file; its graph is checked, but not loaded.

    Raises
    ------
    ModelFileError
        With a sentence that says why the file is not used.
    """
    with refusals_of(path):
        return Manifest.from_dict(open_container(read_limited(path)).manifest)


class TactileModel:
    """A trained classifier, ready to answer.

    Use `load`.

    Parameters
    ----------
    data : bytes
        The model file.
    path : str
        Where it lies; empty: nowhere yet.

    Attributes
    ----------
    path, sha256 : str
        ``sha256`` is that of the file, in hex digits.
    manifest : Manifest
    spec : FeatureSpec
        The features that it takes.
    labels : tuple of str
        What it can answer, in the order of its scores.
    model_id : str
        Task, contact, classifier and the first 12 digits of the file's SHA-256.
    partial_samples : tuple of int
        Sample counts of the partial windows that it answers.
    """

    def __init__(self, data: bytes, path: str = '') -> None:
        self.path = path
        self.sha256 = hashlib.sha256(data).hexdigest()
        container = open_container(data)
        self.manifest = Manifest.from_dict(container.manifest)
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
        self.partial_samples = self.manifest.partial_samples
        self._announced: Mapping[str, FeatureSpec] = {}
        self._stages = {stage.sample_count: stage for stage in self.manifest.stages}
        self._offsets = _read_offsets(self.manifest)
        self._rows = max(1, min(ROWS_AT_ONCE, BYTES_AT_ONCE // len(data)))
        self._session = open_session(container.model)
        self._check_graph()

    @classmethod
    def load(cls, path: str | Path) -> TactileModel:
        """Read and check a model file.

        Raises
        ------
        ModelFileError
            With a sentence that says why the file is not used.
        """
        with refusals_of(path):
            return cls(read_limited(path), str(Path(path).resolve()))

    @property
    def task(self) -> str:
        return self.manifest.task

    @property
    def contact(self) -> str:
        return self.manifest.contact

    def check_fits(self, spec: FeatureSpec) -> None:
        """Raise ModelFileError when features of ``spec`` are not those it was trained on."""
        reason = self.spec.mismatch(spec)
        if reason:
            raise ModelFileError(
                f'model {self.model_id} does not fit the features: {reason} '
                '(here: the model, there: the features)'
            )

    def set_specifications(self, specs: Iterable[FeatureSpec]) -> None:
        """Take in the specifications of the windows to come, as the feature node announces them.

        A model of ready-cut windows does not state how they were cut. It answers windows of each
        announced specification that does not contradict its own; those of any while none is
        announced.
        """
        self._announced = {spec.digest: spec for spec in specs}

    def fits(self, digest: str) -> bool:
        """Return whether the features of a specification are those it was trained on."""
        if not self.spec.missing_parameters:
            return digest == self.spec.digest
        if not self._announced:
            return True
        return digest in self._announced and not self.spec.mismatch(self._announced[digest])

    def compute(self, values: npt.ArrayLike, sample_count: int = 0) -> Answers:
        """Return the answers on many windows of one length.

        Parameters
        ----------
        values : array_like of shape (windows, k)
            Features in the order and units of ``spec``.
        sample_count : int
            Samples in the windows, one of ``partial_samples``; 0: full windows.

        Raises
        ------
        KeyError
            When the model has no answers for windows of that length.
        DatasetError
            When the values have another shape.
        ModelFileError
            When an answer is none of its labels.
        """
        rows = np.asarray(values, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != len(self.spec.names):
            remedy = '; one window is values[np.newaxis]' if rows.ndim == 1 else ''
            raise DatasetError(
                f'the values have shape {rows.shape}; model {self.model_id} takes '
                f'(windows, {len(self.spec.names)}){remedy}'
            )
        rows = np.ascontiguousarray(rows)
        if sample_count in self._offsets:
            rows = rows - self._offsets[sample_count]
        if sample_count not in self._stages:
            raise KeyError(sample_count)
        feed = {SAMPLES: np.array(sample_count)} if self.partial_samples else {}
        blocks = [
            self._session.run(self._outputs, {INPUT: rows[i : i + self._rows], **feed})
            for i in range(0, len(rows), self._rows)
        ]
        found = [np.concatenate(each) for each in zip(*blocks, strict=True)]
        answer, scores, *novelty = found
        if len(answer) and not 0 <= answer.min() <= answer.max() < len(self.labels):
            raise ModelFileError(f'model {self.model_id} answers with a label that it lacks')
        return Answers(answer[:, 0], scores, novelty[0][:, 0] if novelty else np.empty(0))

    def predict(self, values: npt.ArrayLike, sample_count: int = 0) -> list[str]:
        """Return the answers for many windows; arguments as in `compute`."""
        return [self.labels[i] for i in self.compute(values, sample_count).answer]

    def accepts(self, window: FeatureWindow) -> bool:
        """Return whether the window is of its feature set, a known length, no other contact."""
        if window.partial and window.sample_count not in self.partial_samples:
            return False
        is_of_set = window.feature_set == self.spec.feature_set
        return is_of_set and contacts_agree(self.contact, window.contact)

    def classify(
        self, window: FeatureWindow, correction: Correction | None = None
    ) -> ClassificationResult:
        """Return the answer on one window, or why there is none.

        A window whose novelty is above the model's threshold is unknown. A partial window is
        decided when it is known and its answer's probability reaches the stopping rule's.

        Without a correction of the window's session, the model is used as its file is.
        """
        stage = self._stages[window.sample_count if window.partial else 0]
        outcome, label, reason = Outcome.NO_FEATURES, '', self._why_not(window)
        scores: tuple[float, ...] = ()
        novelty = -1.0
        decided = False
        values, novelty_threshold = window.values, stage.novelty_threshold
        if correction is not None:
            novelty_threshold = correction.novelty_threshold
        if not reason:
            if correction is not None:
                values = values - correction.offset
            try:
                found = self.compute(values[np.newaxis], stage.sample_count)
            except ModelFileError as error:
                reason = str(error)
        if not reason:
            scores = tuple(found.scores[0].tolist())
            novelty = float(found.novelty[0]) if len(found.novelty) else -1.0
            if not all(map(math.isfinite, (*scores, novelty))):
                scores, novelty = (), -1.0
                reason = 'the model gives no finite scores for these features'
            elif novelty > novelty_threshold >= 0.0:
                outcome = Outcome.UNKNOWN
                reason = (
                    f'unlike all that the model was trained on: novelty {novelty:.3g}, '
                    f'the threshold is {novelty_threshold:.3g}'
                )
            else:
                outcome, label = Outcome.LABEL, self.labels[int(found.answer[0])]
                decided = max(scores) >= stage.stop_threshold >= 0.0
        return ClassificationResult(
            task=self.manifest.task,
            trial_id=window.trial_id,
            contact=window.contact,
            model_id=self.model_id,
            simulated=window.simulated or self.manifest.simulated,
            outcome=outcome,
            label=label,
            reason=reason,
            labels=self.labels,
            scores=scores,
            score_kind=self.manifest.score_kind,
            novelty=novelty,
            novelty_threshold=novelty_threshold,
            window_start_ns=window.window_start_ns,
            window_end_ns=window.window_end_ns,
            frame_id=window.frame_id,
            false_alarm_rate=self.manifest.false_alarm_rate,
            partial=window.partial,
            decided=decided if window.partial else True,
            error_rate=self.manifest.stop_error_rate if window.partial else -1.0,
            recalibration_trials=0 if correction is None else correction.trials,
        )

    def _why_not(self, window: FeatureWindow) -> str:
        if window.outcome != FeatureOutcome.OK:
            return window.reason or f'the window ended with {FeatureOutcome(window.outcome).name}'
        reason = self.format_mismatch(window)
        if reason:
            return reason
        if not np.isfinite(window.values).all():
            return 'the features are not finite'
        return ''

    def format_mismatch(self, window: FeatureWindow) -> str:
        """Return why a window has features of another specification, or an empty string.

        The fields of the message are compared one by one. The digest tells that something else
        differs: it is named where the specification of the window is announced; otherwise all
        parameters of the model are.
        """
        spec = self.spec
        pairs = [
            ('feature set', window.feature_set, spec.feature_set),
            ('version of the feature set', window.feature_set_version, spec.version),
            ('rate in Hz', window.rate_hz, spec.rate_hz),
        ]
        if window.outcome == FeatureOutcome.OK:
            if spec.sample_count and not window.partial:
                pairs.append(('window in samples', window.sample_count, spec.sample_count))
            pairs.append(('number of features', len(window.values), len(spec.names)))
        for what, got, wanted in pairs:
            if got != wanted:
                return f'the {what} is {got}; the model was trained on {wanted}: {_REMEDY}'
        digest = window.specification_digest
        if self.fits(digest):
            return ''
        if digest in self._announced and (reason := spec.mismatch(self._announced[digest])):
            return f'{reason} (here: the model, there: the features): {_REMEDY}'
        values = ', '.join(
            f'{name} {value if isinstance(value, str) else format(value, "g")}'
            for name, value in sorted(spec.parameters.items())
        )
        return (
            'the features were made by another specification than the model was trained on '
            f'(digest {digest} instead of {spec.digest}, with {values}): {_REMEDY}'
        )

    def _check_graph(self) -> None:
        """Try the graph once: its width, its outputs and their types."""
        inputs = self._session.get_inputs()
        self._outputs = [output.name for output in self._session.get_outputs()]
        k, labels = len(self.spec.names), len(self.labels)
        has_novelty = {stage.novelty_threshold >= 0.0 for stage in self.manifest.stages}
        wanted = [ANSWER, SCORES, NOVELTY] if has_novelty == {True} else [ANSWER, SCORES]
        sources = [INPUT, SAMPLES] if self.partial_samples else [INPUT]
        if [i.name for i in inputs] != sources or self._outputs != wanted:
            raise ModelFileError(
                f'its graph does not lead from {", ".join(sources)} to {", ".join(wanted)}'
            )
        if inputs[0].type != 'tensor(double)' or inputs[0].shape[1:] != [k]:
            raise ModelFileError(
                f'its graph takes {inputs[0].type} of shape {inputs[0].shape}; '
                f'the feature set has {k} features, as doubles'
            )
        for stage in self.manifest.stages:
            try:
                found = self.compute(np.zeros((1, k)), stage.sample_count)
            except Exception as error:  # onnxruntime has many
                raise ModelFileError(f'its graph does not run: {error}') from error
            if found.scores.shape != (1, labels):
                raise ModelFileError(
                    f'its graph gives scores of shape {found.scores.shape}; it has {labels} labels'
                )
            if found.answer.dtype != np.int64 or not 0 <= found.answer[0] < labels:
                raise ModelFileError('its graph gives answers that are none of its labels')


def _read_offsets(manifest: Manifest) -> dict[int, npt.NDArray[np.float64]]:
    """Return what a recalibrated model takes off features, by samples; empty: nothing."""
    entry = manifest.calibration.get('recalibrated', {'offsets': []})
    try:
        offsets = [np.array(offset, dtype=np.float64) for offset in entry['offsets']]
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ModelFileError(f'its recalibration is damaged: {error}') from error
    shape = (len(manifest.spec.names),)
    if any(offset.shape != shape or not np.isfinite(offset).all() for offset in offsets):
        raise ModelFileError('its recalibration does not fit its features')
    if offsets and len(offsets) != len(manifest.stages):
        raise ModelFileError('its recalibration does not have one offset a stage')
    counts = [stage.sample_count for stage in manifest.stages]
    return dict(zip(counts, offsets, strict=False))
