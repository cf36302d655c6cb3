# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node around `TactileModel`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tactile_classifier.conversions import classification_to_msg
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.inference import TactileModel
from tactile_classifier.model_file.live_recalibration import LiveRecalibration
from tactile_classifier.records import ClassificationResult, ClassifierConfig
from tactile_classifier.vision import vision_class, vision_from_msg
from tactile_features.conversions import feature_window_from_msg, feature_window_from_record
from tactile_features.records import FeatureWindow
from tactile_features.spec import spec_for
from tactile_msgs.msg import Classification, TactileFeatures
from tactile_ros.bus.data_node import DataNode
from tactile_ros.bus.local_bus import RecordPublisher, RecordSubscription
from tactile_ros.health.diagnostics import Diagnostics, Health, OK, WARN
from tactile_ros.programs.node_group import run_node
from tactile_ros.qos import RESULTS

LOG_PERIOD_S = 10.0


class TactileClassifierNode(DataNode):
    """Publishes ``~/classification`` for every window of features that its model accepts.

    With a model that answers partial windows, also ``~/partial_classification`` for these, while
    the window fills; the first decided answer of each trial goes to the log.

    With the parameter ``vision_messages`` answers go to ``~/vision_classification``, too.

    Configuring loads the model; one that does not fit the parameters is refused. With the
    parameter ``recalibration_trials`` the first known trials of each session correct its
    answers, not its file.

    Attributes
    ----------
    model : TactileModel or None
        None before the first configuration.
    seen_count : int
        Windows that came in while active.
    ignored_count : int
        Those of another feature set or another contact.
    published_count : int
        Those that were answered.
    refused_count : int
        Those of them, partial ones too, whose features are of another specification than the
        model's: they are answered with the reason.
    partial_count : int
        Partial windows that were answered.
    """

    def __init__(self, node_name: str = 'tactile_classifier', **node_options: Any) -> None:
        super().__init__(node_name, ClassifierConfig, **node_options)
        self.model: TactileModel | None = None
        self.seen_count = 0
        self.ignored_count = 0
        self.published_count = 0
        self.refused_count = 0
        self.partial_count = 0
        self._mismatch = ''
        self._recalibrated_with = 0
        self._publisher: Any = None
        self._partial_publisher: Any = None
        self._vision_publisher: Any = None
        self._diagnostics: Diagnostics | None = None
        self._inputs: list[RecordSubscription] = []
        self._decided_trial: tuple[str, int] | None = None

    def set_up(self, config: ClassifierConfig) -> None:
        model = self.model = load_fitting_model(config)
        recalibration = LiveRecalibration(model, config.recalibration_trials)
        self._publisher = self._add_publisher('~/classification')
        if config.vision_messages:
            self._vision_publisher = self.publish_records(
                vision_class(),
                '~/vision_classification',
                lambda result: vision_from_msg(classification_to_msg(result)),
                RESULTS,
            )
        self._subscribe('tactile_features/features', self._on_features, recalibration)
        if model.partial_samples:
            self._partial_publisher = self._add_publisher('~/partial_classification')
            self._subscribe('tactile_features/partial_features', self._on_partial, recalibration)
            counts = ', '.join(map(str, model.partial_samples))
            self.get_logger().info(
                f'{model.model_id} answers partial windows: the parameter partial_samples of the '
                f'feature node should be [{counts}]'
            )
        self._diagnostics = Diagnostics(self, lambda: model.model_id, self._assess)
        self.get_logger().info(f'{model.model_id} knows {", ".join(model.labels)}')
        missing = ', '.join(model.spec.missing_parameters)
        if missing:
            self.get_logger().warning(
                f'the file of {model.model_id} does not state {missing}: the parameters of this '
                'node are taken for what it was trained with'
            )

    def _add_publisher(self, topic: str) -> RecordPublisher:
        return self.publish_records(Classification, topic, classification_to_msg, RESULTS)

    def _subscribe(
        self,
        topic: str,
        callback: Callable[[LiveRecalibration, FeatureWindow], None],
        recalibration: LiveRecalibration,
    ) -> None:
        self._inputs.append(
            self.subscribe_records(
                TactileFeatures,
                topic,
                lambda window: callback(recalibration, window),
                from_message=feature_window_from_msg,
                from_record=feature_window_from_record,
                profile=RESULTS,
            )
        )

    def tear_down(self) -> None:
        while self._inputs:
            self._inputs.pop().close()
        if self._diagnostics is not None:
            self._diagnostics.close()
            self._diagnostics = None
        for publisher in (self._publisher, self._partial_publisher, self._vision_publisher):
            if publisher is not None:
                publisher.close()
        self._publisher = self._partial_publisher = self._vision_publisher = None

    def _on_features(self, recalibration: LiveRecalibration, window: FeatureWindow) -> None:
        model = recalibration.model
        if not self.is_active:
            return
        self.seen_count += 1
        if not model.accepts(window) or not self.config.takes_contact(window.contact):
            self.ignored_count += 1
            return
        self._note_mismatch(model.describe_mismatch(window))
        result = recalibration.classify(window)
        self._note_recalibration(result, window)
        self._publisher.publish(result)
        if self._vision_publisher is not None:
            self._vision_publisher.publish(result)
        self.published_count += 1

    def _on_partial(self, recalibration: LiveRecalibration, window: FeatureWindow) -> None:
        model = recalibration.model
        if not self.is_active:
            return
        if not model.accepts(window) or not self.config.takes_contact(window.contact):
            return
        self._note_mismatch(model.describe_mismatch(window))
        result = recalibration.classify(window)
        self._partial_publisher.publish(result)
        self.partial_count += 1
        trial = (result.trial_id, result.window_start_ns)
        if result.decided and trial != self._decided_trial:
            self._decided_trial = trial
            seconds = (result.window_end_ns - result.window_start_ns) / 1e9
            self.get_logger().info(
                f'{result.label} after {seconds:.2f} s of the window, '
                f'probability {max(result.scores):.3f} (trial {result.trial_id})'
            )

    def _note_recalibration(self, result: ClassificationResult, window: FeatureWindow) -> None:
        if result.recalibration_trials != self._recalibrated_with:
            self._recalibrated_with = result.recalibration_trials
            what = (
                f'recalibrated with {result.recalibration_trials} known trials'
                if result.recalibration_trials
                else 'as trained, until there are known trials'
            )
            self.get_logger().info(f'session "{window.session_id}": {result.model_id} {what}')

    def _note_mismatch(self, reason: str) -> None:
        """Count a window of another specification; tell it at once and then now and then."""
        self._mismatch = reason
        if reason:
            self.refused_count += 1
            self.get_logger().warning(reason, throttle_duration_sec=LOG_PERIOD_S)

    def _assess(self) -> Health:
        return Health(
            WARN if self._mismatch else OK,
            self._mismatch or 'the model is loaded',
            {
                'windows': self.seen_count,
                'answers': self.published_count,
                'windows for others': self.ignored_count,
                'windows of another specification': self.refused_count,
                'early predictions': self.partial_count,
                'recalibrated with trials': self._recalibrated_with,
                'active': self.is_active,
            },
        )


def load_fitting_model(config: ClassifierConfig) -> TactileModel:
    """Return the model that the parameters name.

    Raises
    ------
    ModelFileError
        When there is none, or it was made for something else.
    """
    if not config.model:
        raise ModelFileError('the parameter model is empty: it must be the path of a model file')
    model = TactileModel.load(config.model)
    if model.task != config.task:
        raise ModelFileError(
            f'model {model.model_id} is for {model.task}; the parameter task is {config.task}'
        )
    if not config.takes_contact(model.contact):
        raise ModelFileError(
            f'model {model.model_id} was trained on {model.contact}; '
            f'the parameter contact is {config.contact}'
        )
    model.expect(spec_for(config.task, config.feature_config()))
    return model


def main() -> int:
    """Run the node."""
    return run_node(TactileClassifierNode)
