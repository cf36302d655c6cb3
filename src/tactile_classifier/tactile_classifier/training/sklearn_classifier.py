# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`TactileClassifier`: training and model files with the interface of scikit-learn."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple
import warnings

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClassifierMixin, clone
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_consistent_length, check_is_fitted, column_or_1d

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import FOLDS, grouped_split, stratified_split
from tactile_classifier.errors import DatasetError
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    NearestNeighbours,
    RANDOM_STATE,
    SupportVectorMachine,
)
from tactile_classifier.estimators.random_convolutions import RandomConvolutionClassifier
from tactile_classifier.evaluation.plans import run_plans
from tactile_classifier.model_file.model import TactileModel
from tactile_classifier.training.feature_choice import (
    ChoicePlan,
    FeatureChoice,
    INNER_REPEATS,
    MANY_TRIALS,
)
from tactile_classifier.training.model_writer import pack_trained, write_model
from tactile_classifier.training.trainer import check_size, train, Trained
from tactile_classifier.types import CONTACTS, NEIGHBOURS, NO_ANSWER, ROCKET, TASKS, UNKNOWN
from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.estimators import FeatureTransformer, SpatialTransformer, validate_data
from tactile_features.extraction.extractor import features_from_trials
from tactile_features.feature_sets.registry import (
    CHOOSER,
    find_feature_set,
    list_feature_sets,
    PHASE_OF_TASK,
)

AUTO = 'auto'
"""Value of ``pipeline``: choose features, classifier and scaling automatically."""

WRITABLE = (
    "KNeighborsClassifier(n_neighbors=3), SVC(kernel='linear') or SVC(kernel='rbf'), "
    'DecisionTreeClassifier and RandomConvolutionClassifier'
)
"""The classifiers that a model file can contain."""

_GROUP = 'session_id'

_MACHINE = ('C', 'gamma', 'class_weight', 'tol', 'shrinking')
_TAKEN: Mapping[str, tuple[str, ...]] = {
    'knn': (),
    'svm_linear': _MACHINE,
    'svm_rbf': _MACHINE,
    'tree': tuple(DecisionTreeClassifier().get_params()),
    ROCKET: ('random_state',),
}
"""Parameters of each classifier that can be set by the user; `build_estimator` sets the others."""

Matrix = npt.NDArray[np.float64]


class TactileClassifier(ClassifierMixin, BaseEstimator):
    """A classifier of windows of tension that can be saved as a model file.

    As in ``tactile train``, the probabilities and the threshold for unknown objects are computed
    from held-out groups. The predictions equal those of the model file.

    Parameters
    ----------
    pipeline : Pipeline or 'auto'
        A pipeline of steps that a model file can contain: a transformer of
        `tactile_features.estimators`, an optional ``StandardScaler()``, and a classifier. The
        classifier is ``KNeighborsClassifier(n_neighbors=3)``, ``SVC(kernel='linear')``,
        ``SVC(kernel='rbf')``, ``DecisionTreeClassifier()`` or `RandomConvolutionClassifier`.
        Support vector machines break ties by their decision values (``break_ties=True``), and
        ``probability``, ``max_iter`` and ``decision_function_shape`` have no effect. If
        ``'auto'``, the features, the classifier and the scaling are chosen by their accuracy on
        held-out groups.
    task : {'texture', 'stiffness'}
        Only for ``'auto'``: ``'texture'`` for windows of glides, ``'stiffness'`` for windows of
        holds.
    rate_hz : float
        Only for ``'auto'``: sample rate of the windows [Hz].
    speed_column : int or None
        Only for ``'auto'``: column of ``X`` with the sliding speed of each window [m/s]. If it is
        None, features over distance are not candidates.
    contact : {'', 'flexion', 'abduction'}
        Contact of the windows; empty if unknown. A live classifier then uses the model only for
        windows of this contact.
    simulated : bool
        True if the windows are simulated; this is stored in the model file.
    false_alarm_rate : float
        Fraction of windows of known labels that may be rejected as unknown [1], on average over
        groups.
    strict : bool
        If True, the fraction holds in most new groups, but fewer unknown objects are detected.
    random_state : int
        Seed of the folds of ``'auto'``.
    n_jobs : int or None
        Number of worker processes for ``'auto'``. None means 1, and -1 means all cores.

    Attributes
    ----------
    classes_ : ndarray of shape (classes,)
        Labels.
    model_ : TactileModel
        The model as it would be loaded from its file.
    trained_ : Trained
        The fitted scikit-learn pipeline (without the transformer), the calibration and the
        manifest.
    choice_ : FeatureChoice or None
        For ``'auto'``, the scores of all candidates and the nested score; otherwise None.
    n_features_in_ : int
        Columns of ``X`` in ``fit``.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.pipeline import make_pipeline
    >>> from sklearn.preprocessing import StandardScaler
    >>> from sklearn.svm import SVC
    >>> from tactile_classifier import TactileClassifier
    >>> from tactile_features.estimators import TextureSpectrum
    >>> rng = np.random.default_rng(0)
    >>> y, session = np.repeat(['rough', 'smooth'], 30), np.tile([1, 2, 3], 20)
    >>> pitch_hz = np.where(y == 'rough', 4.0, 9.0)[:, np.newaxis]
    >>> phase = 2 * np.pi * (pitch_hz * np.arange(180) / 60 + rng.random((60, 1)))
    >>> X = 3.0 + 0.05 * np.sin(phase) + rng.normal(0.0, 0.01, (60, 180))
    >>> pipe = make_pipeline(TextureSpectrum(rate_hz=60), StandardScaler(), SVC(kernel='linear'))
    >>> model = TactileClassifier(pipe).fit(X, y, groups=session)
    >>> model.predict(X[[0, -1]]).tolist()
    ['rough', 'smooth']
    """

    def __init__(
        self,
        pipeline: Any = AUTO,
        *,
        task: str = 'texture',
        rate_hz: float = 60.0,
        speed_column: int | None = None,
        contact: str = '',
        simulated: bool = False,
        false_alarm_rate: float = 0.05,
        strict: bool = False,
        random_state: int = RANDOM_STATE,
        n_jobs: int | None = None,
    ) -> None:
        self.pipeline = pipeline
        self.task = task
        self.rate_hz = rate_hz
        self.speed_column = speed_column
        self.contact = contact
        self.simulated = simulated
        self.false_alarm_rate = false_alarm_rate
        self.strict = strict
        self.random_state = random_state
        self.n_jobs = n_jobs

    def fit(
        self,
        X: npt.ArrayLike,  # noqa: N803
        y: npt.ArrayLike,
        groups: npt.ArrayLike | None = None,
    ) -> TactileClassifier:
        """Train the classifier, and calibrate it on held-out groups.

        Parameters
        ----------
        X : array_like of shape (windows, samples)
            Tension [N]. If there is a speed column, it contains the sliding speeds [m/s].
        y : array_like of shape (windows,)
            Labels. In the model file, they are stored as text.
        groups : array_like of shape (windows,), optional
            Group of each window. Windows of one group share a state of the rig, such as a session
            or a mounting. If given, the probabilities and the threshold hold for new groups. If
            omitted, single windows are held out, and the accuracy in a new session may be lower.

        Returns
        -------
        TactileClassifier
            This object.

        Raises
        ------
        ValueError
            When the pipeline cannot be written to a model file, a parameter or a shape is invalid,
            a value is not finite, or there are too few windows.
        """
        rows, y = validate_data(self, X, y, dtype=np.float64, ensure_min_features=2)
        check_classification_targets(y)
        self.classes_, codes = np.unique(y, return_inverse=True)
        labels = self._names[codes]
        if self.contact not in ('', *CONTACTS):
            raise ValueError(f'contact is "{self.contact}"; it must be {" or ".join(CONTACTS)}')
        windows, speeds_m_s = self._divide(rows)
        columns: dict[str, npt.NDArray[Any]] = {
            'simulated': np.full(len(rows), bool(self.simulated))
        }
        if self.contact:
            columns['contact'] = np.full(len(rows), self.contact)
        if speeds_m_s is not None:
            columns['glide_speed_m_s'] = speeds_m_s
        if groups is not None:
            columns[_GROUP] = column_or_1d(groups)
            check_consistent_length(rows, columns[_GROUP])
        self.choice_ = None
        parameters: dict[str, Any] = {}
        if _is_auto(self.pipeline):
            tables = self._make_tables(windows, speeds_m_s, labels, columns)
            self.choice_ = self._choose(tables, groups is not None)
            name, classifier, scaling = self.choice_.chosen
            table = tables[name]
        else:
            transformer, classifier, scaling, parameters = read_pipeline(self.pipeline)
            features = clone(transformer).fit(rows)
            values = features.transform(rows)
            table = FeatureTable(values, labels, features.specification_, columns)
            if isinstance(weights := parameters.get('class_weight'), Mapping):
                names = dict(zip(self.classes_.tolist(), self._names.tolist(), strict=True))
                parameters['class_weight'] = {names.get(k, str(k)): w for k, w in weights.items()}
        self.trained_ = train(
            table,
            classifier,
            scaling,
            false_alarm_rate=self.false_alarm_rate,
            strict=self.strict,
            choice=self.choice_,
            hold_out=(_GROUP,),
            parameters=parameters,
        )
        self.model_ = TactileModel(pack_trained(self.trained_))
        _warn_of_calibration(self.trained_, groups is not None)
        return self

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[Any]:  # noqa: N803
        """Return the most likely of ``classes_`` for each row of ``X``, even for unknown objects.

        Raises
        ------
        ValueError
            When the shape is another than in ``fit``, a value is not finite, or a feature of a
            window is undefined.
        """
        values = self._compute_features(X)
        labels = self.model_.predict(values)
        order = np.argsort(self._names)
        return self.classes_[order[np.searchsorted(self._names, labels, sorter=order)]]

    def predict_or_unknown(self, X: npt.ArrayLike) -> npt.NDArray[Any]:  # noqa: N803
        """Return a label, ``'unknown'`` or ``'no answer'`` for each row of ``X``.

        ``'no answer'`` means that a feature of the window is undefined. The result is an array of
        str if ``classes_`` is one, otherwise an array of objects. Raises ValueError as `predict`
        does, but not for undefined features.
        """
        values = self._compute_features(X)
        found = self.model_.predict_or_unknown(values)
        if self.classes_.dtype.kind == 'U':
            return found
        classes = {UNKNOWN: UNKNOWN, NO_ANSWER: NO_ANSWER}
        classes |= dict(zip(self._names.tolist(), self.classes_.tolist(), strict=True))
        return np.array([classes[label] for label in found.tolist()], dtype=object)

    def predict_proba(self, X: npt.ArrayLike) -> Matrix:  # noqa: N803
        """Return the calibrated probability of each of ``classes_`` [1], shape (windows, classes).

        Raises
        ------
        ValueError
            As in `predict`, and when ``fit`` had too few windows for a calibration.
        """
        values = self._compute_features(X)
        found = self.model_.predict_proba(values)
        return found[:, np.searchsorted(self.model_.labels, self._names)]

    def novelty(self, X: npt.ArrayLike) -> Matrix:  # noqa: N803
        """Return the distance of each row of ``X`` to the training windows [1].

        If it exceeds ``model_.manifest.confidence.novelty_threshold``, the window is unknown.
        Raises ValueError as `predict_proba` does.
        """
        values = self._compute_features(X)
        return self.model_.novelty(values)

    def p_value(self, X: npt.ArrayLike) -> Matrix:  # noqa: N803
        """Return the fraction of held-out windows that are at least as novel as each row of ``X``.

        A small value means that the window is unlike the training windows. Raises ValueError as
        `predict_proba` does.
        """
        values = self._compute_features(X)
        return self.model_.p_value(values)

    def save(self, path: str | Path) -> TactileModel:
        """Write a model file that `load_model` and the classifier node can read.

        Returns the model, loaded from the written bytes.

        Raises
        ------
        ModelFileError
            When the file cannot be written, or a label differs from that of scikit-learn by more
            than rounding.
        """
        check_is_fitted(self)
        return write_model(path, self.trained_)

    @property
    def _names(self) -> npt.NDArray[np.str_]:
        """The labels in the model file, shape (classes,)."""
        names = np.array([str(label) for label in self.classes_.tolist()])
        if len(np.unique(names)) < len(names):
            raise ValueError(
                'several labels have the same text, but a model file stores labels as text: '
                'rename them'
            )
        return names

    def _divide(self, rows: Matrix) -> tuple[Matrix, Matrix | None]:
        """Return the windows [N], and their sliding speeds [m/s] or None if they are not given."""
        if not _is_auto(self.pipeline):
            return read_pipeline(self.pipeline).transformer.split(rows)
        if self.speed_column is None:
            return rows, None
        return SpatialTransformer(speed_column=self.speed_column).split(rows)

    def _compute_features(self, X: npt.ArrayLike) -> Matrix:  # noqa: N803
        check_is_fitted(self)
        rows = validate_data(self, X, dtype=np.float64, reset=False)
        windows, speeds_m_s = self._divide(rows)
        return self.model_.compute_features(windows, 0.0 if speeds_m_s is None else speeds_m_s)

    def _make_tables(
        self,
        windows: Matrix,
        speeds_m_s: Matrix | None,
        labels: npt.NDArray[np.str_],
        columns: Mapping[str, npt.NDArray[Any]],
    ) -> dict[str, FeatureTable]:
        """Return one table for each feature set of the task.

        If a feature set has no features for a window, it is left out with a warning.
        """
        if self.task not in TASKS:
            raise ValueError(f'task is "{self.task}"; it must be {" or ".join(TASKS)}')
        phase = PHASE_OF_TASK[self.task]
        tables: dict[str, FeatureTable] = {}
        left_out = []
        for name in list_feature_sets(phase):
            if speeds_m_s is None and getattr(find_feature_set(name), 'needs_speed', False):
                continue
            fields: dict[str, Any] = {CHOOSER[phase]: name}
            config = FeatureConfig(**fields)
            try:
                values, spec = features_from_trials(
                    self.task, windows, self.rate_hz, config=config, speeds_m_s=speeds_m_s
                )
                table = FeatureTable(values, labels, spec, columns)
                check_size(table)
            except (FeatureError, DatasetError) as error:
                left_out.append(f'{name} is left out: {error}')
            else:
                tables[name] = table
        if not tables:
            raise DatasetError('; '.join(left_out))
        for sentence in left_out:
            warnings.warn(sentence, stacklevel=3)
        return tables

    def _choose(self, tables: Mapping[str, FeatureTable], has_groups: bool) -> FeatureChoice:
        """Choose a candidate with `ChoicePlan` and the same folds as ``tactile train``."""
        first = next(iter(tables.values()))
        if has_groups:
            split = grouped_split(first, [_GROUP])
        else:
            repeats = INNER_REPEATS if len(first) <= MANY_TRIALS else 1
            split = stratified_split(first, FOLDS, repeats, self.random_state)
        plan = ChoicePlan(tables, split, self.random_state)
        ((choice,),) = run_plans([plan], self.n_jobs)
        for sentence in (*choice.left_out, *filter(None, [plan.no_choice])):
            warnings.warn(sentence, stacklevel=3)
        assert isinstance(choice, FeatureChoice)
        return choice


class PipelineParts(NamedTuple):
    """Parts of a pipeline, as arguments of `train`.

    ``parameters`` contains the parameters of the classifier that differ from our defaults.
    """

    transformer: FeatureTransformer
    classifier: str
    scaling: str
    parameters: dict[str, Any]


def read_pipeline(pipeline: Any) -> PipelineParts:
    """Return the parts of a pipeline.

    Raises ValueError if a model file cannot contain the pipeline.
    """
    if not isinstance(pipeline, Pipeline):
        raise ValueError(
            f'pipeline is {pipeline!r}; it must be "{AUTO}", or a Pipeline of a transformer of '
            'tactile_features.estimators and a classifier'
        )
    first, *steps = (step for _, step in pipeline.steps if step not in (None, 'passthrough'))
    if not isinstance(first, FeatureTransformer):
        raise ValueError(
            f'the pipeline begins with {first!r}; it must begin with a transformer of '
            'tactile_features.estimators, such as TextureSpectrum(rate_hz=60)'
        )
    scalers, classifier = steps[:-1], steps[-1] if steps else None
    for step in scalers:
        is_standard = type(step) is StandardScaler and step.with_mean and step.with_std
        if not is_standard or len(scalers) > 1:
            raise ValueError(
                f'a model file cannot contain {step!r}; between features and classifier, only one '
                f'StandardScaler() is possible. {_REMEDY}'
            )
    name = _name_classifier(classifier)
    if name is None:
        raise ValueError(f'a model file cannot contain {classifier!r}, only {WRITABLE}. {_REMEDY}')
    scaling = 'standard' if scalers else 'none'
    return PipelineParts(first, name, scaling, _find_parameters(name, classifier))


_REMEDY = 'In Python, you can use the pipeline without TactileClassifier, and store it with joblib'


def _is_auto(pipeline: Any) -> bool:
    return isinstance(pipeline, str) and pipeline == AUTO


def _name_classifier(classifier: Any) -> str | None:
    """Return our name of a classifier, or None if a model file cannot contain it."""
    kind = type(classifier)
    if kind in (KNeighborsClassifier, NearestNeighbours):
        is_euclidean = (classifier.metric, classifier.p) == ('minkowski', 2)
        is_euclidean = is_euclidean or classifier.metric == 'euclidean'
        is_plain = classifier.n_neighbors == NEIGHBOURS and classifier.weights == 'uniform'
        return 'knn' if is_plain and is_euclidean else None
    if kind in (SVC, SupportVectorMachine):
        return f'svm_{classifier.kernel}' if classifier.kernel in ('linear', 'rbf') else None
    if kind is DecisionTreeClassifier:
        return 'tree'
    is_convolution = kind is RandomConvolutionClassifier and classifier.channels == 1
    return ROCKET if is_convolution else None


def _find_parameters(name: str, classifier: Any) -> dict[str, Any]:
    """Return the parameters in `_TAKEN` whose values differ from our defaults."""
    ours, stated = build_estimator(name, 'none')[-1].get_params(), classifier.get_params()
    if stated.get('random_state') is None:
        stated.pop('random_state', None)
    return {key: stated[key] for key in _TAKEN[name] if key in stated and stated[key] != ours[key]}


def _warn_of_calibration(trained: Trained, has_groups: bool) -> None:
    calibration = trained.manifest.calibration
    if 'reason' in calibration:
        warnings.warn(
            'there are no calibrated probabilities, and no window can be unknown: '
            f'{calibration["reason"]}',
            stacklevel=3,
        )
    elif has_groups and not calibration['groups']:
        warnings.warn(
            'no group is held out, because a label occurs in only one group: probabilities and '
            'the threshold for unknown objects hold only for windows of these groups',
            stacklevel=3,
        )
