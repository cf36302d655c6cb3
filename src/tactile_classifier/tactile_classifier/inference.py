# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""A model file in use: checked when loaded, then one answer a window."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import ModelFileError
from tactile_classifier.manifest import Manifest
from tactile_classifier.onnx_container import check_seal, open_container
from tactile_classifier.records import ClassificationResult, Outcome
from tactile_features.records import FeatureWindow
from tactile_features.records import Outcome as FeatureOutcome
from tactile_features.spec import FeatureSpec

__all__ = ['ClassificationResult', 'TactileModel']

MAX_MODEL_BYTES = 64 * 2**20
"""Larger files are not read [byte]."""

ROWS_AT_ONCE = 64
"""Kernels take memory in proportion to rows."""

INPUT, OUTPUT = 'features', 'scores'


class TactileModel:
    """A trained classifier, ready to answer.

    Use `load`.

    Attributes
    ----------
    manifest : Manifest
    spec : FeatureSpec
        The features that it takes.
    labels : tuple of str
        What it can answer, in the order of its scores.
    model_id : str
        Task, contact, classifier and the first 12 digits of the file's SHA-256.
    """

    def __init__(self, data: bytes) -> None:
        text = open_container(data)
        self.manifest = Manifest.from_json(text)
        check_seal(data)
        self.spec: FeatureSpec = self.manifest.spec
        self.labels = self.manifest.labels
        self.model_id = '-'.join(
            (
                self.manifest.task,
                self.manifest.contact or 'any',
                self.manifest.classifier,
                hashlib.sha256(data).hexdigest()[:12],
            )
        )
        self._session = _open_session(data)
        self._check_graph()

    @classmethod
    def load(cls, path: str | Path) -> TactileModel:
        """Read and check a model file.

        Raises
        ------
        ModelFileError
            With a sentence that says why the file is not used.
        """
        path = Path(path)
        try:
            size = path.stat().st_size
            if size > MAX_MODEL_BYTES:
                raise ModelFileError(
                    f'it has {size / 2**20:.0f} MiB, the limit is {MAX_MODEL_BYTES >> 20} MiB'
                )
            return cls(path.read_bytes())
        except OSError as error:
            raise ModelFileError(f'cannot read model {path}: {error.strerror}') from error
        except ModelFileError as error:
            raise ModelFileError(f'model {path} is refused: {error}') from error

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

    def compute_scores(self, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the scores of many windows.

        Parameters
        ----------
        values : array_like of shape (windows, k)
            Features in the order and units of ``spec``.

        Returns
        -------
        ndarray of shape (windows, labels)
            Larger is likelier; the answer is the first largest.
        """
        rows = np.ascontiguousarray(values, dtype=np.float64)
        blocks = [
            self._session.run([OUTPUT], {INPUT: rows[i : i + ROWS_AT_ONCE]})[0]
            for i in range(0, len(rows), ROWS_AT_ONCE)
        ]
        return np.asarray(np.concatenate(blocks), dtype=np.float64)

    def predict(self, values: npt.ArrayLike) -> list[str]:
        """Return the answers for many windows, shape as in `compute_scores`."""
        return [self.labels[i] for i in self.compute_scores(values).argmax(axis=1)]

    def accepts(self, window: FeatureWindow) -> bool:
        """Return whether the window is of its feature set and not of another contact."""
        contacts = {self.contact, window.contact} - {''}
        return window.feature_set == self.spec.feature_set and len(contacts) < 2

    def classify(self, window: FeatureWindow) -> ClassificationResult:
        """Return what the model says of one window, or why it says nothing."""
        reason = self._why_not(window)
        scores: tuple[float, ...] = ()
        if not reason:
            scores = tuple(self.compute_scores(window.values[np.newaxis])[0].tolist())
            if not all(map(math.isfinite, scores)):
                scores, reason = (), 'the model gives no finite scores for these features'
        return ClassificationResult(
            task=self.manifest.task,
            trial_id=window.trial_id,
            contact=window.contact,
            model_id=self.model_id,
            simulated=window.simulated or self.manifest.simulated,
            outcome=Outcome.NO_FEATURES if reason else Outcome.LABEL,
            label='' if reason else self.labels[scores.index(max(scores))],
            reason=reason,
            labels=self.labels,
            scores=scores,
            score_kind=self.manifest.score_kind,
            novelty=-1.0,
            novelty_threshold=-1.0,
            window_start_ns=window.window_start_ns,
            window_end_ns=window.window_end_ns,
            frame_id=window.frame_id,
        )

    def _why_not(self, window: FeatureWindow) -> str:
        if window.outcome != FeatureOutcome.OK:
            return window.reason or f'the window ended with {FeatureOutcome(window.outcome).name}'
        spec = self.spec
        pairs = [
            ('feature set', window.feature_set, spec.feature_set),
            ('version of the feature set', window.feature_set_version, spec.version),
            ('rate in Hz', window.rate_hz, spec.rate_hz),
            ('number of features', len(window.values), len(spec.names)),
        ]
        if spec.sample_count:
            pairs.append(('window in samples', window.sample_count, spec.sample_count))
        for what, got, wanted in pairs:
            if got != wanted:
                return f'the {what} is {got}; the model was trained on {wanted}'
        if not np.isfinite(window.values).all():
            return 'the features are not finite'
        return ''

    def _check_graph(self) -> None:
        """Try the graph once: its width, its scores and their type."""
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        k = len(self.spec.names)
        if [i.name for i in inputs] != [INPUT] or [o.name for o in outputs] != [OUTPUT]:
            raise ModelFileError(f'its graph does not lead from "{INPUT}" to "{OUTPUT}"')
        if inputs[0].type != 'tensor(double)' or inputs[0].shape[1:] != [k]:
            raise ModelFileError(
                f'its graph takes {inputs[0].type} of shape {inputs[0].shape}; '
                f'the feature set has {k} features, as doubles'
            )
        try:
            shape = self.compute_scores(np.zeros((1, k))).shape
        except Exception as error:  # onnxruntime has many
            raise ModelFileError(f'its graph does not run: {error}') from error
        if shape != (1, len(self.labels)):
            raise ModelFileError(
                f'its graph gives scores of shape {shape}; it has {len(self.labels)} labels'
            )


def _open_session(data: bytes) -> Any:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # one row: a thread pool costs more than it brings
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # what goes wrong comes as an exception
    try:
        return onnxruntime.InferenceSession(data, options, providers=['CPUExecutionProvider'])
    except Exception as error:
        raise ModelFileError(f'onnxruntime cannot load its graph: {error}') from error
