# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node around `ModelSet`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tactile_classifier.answering import Answering
from tactile_classifier.conversions import classification_to_msg, model_infos_to_msg
from tactile_classifier.model_file.model_set import ModelSet
from tactile_classifier.records import ClassifierConfig, ModelInfos
from tactile_classifier.vision import vision_class, vision_from_msg
from tactile_features.conversions import (
    feature_window_from_msg,
    feature_window_from_record,
    specifications_from_msg,
)
from tactile_features.records import FeatureWindow
from tactile_msgs.msg import (
    Classification,
    FeatureSpecifications,
    TactileFeatures,
)
from tactile_msgs.msg import (
    ModelInfos as ModelInfosMsg,
)
from tactile_ros.bus.data_node import DataNode
from tactile_ros.bus.local_bus import RecordPublisher, RecordSubscription
from tactile_ros.health.diagnostics import Diagnostics, Health, OK, WARN
from tactile_ros.programs.node_group import run_node
from tactile_ros.qos import LATEST, RESULTS

LOG_PERIOD_S = 10.0


class TactileClassifierNode(DataNode):
    """Publishes ``~/classification``: one message of each model that a window of features fits.

    With a model that answers partial windows, also ``~/partial_classification`` for these, while
    the window fills; the first decided answer of each trial goes to the log. The models are on
    ``~/models``, latched, from the configuration on.

    With the parameter ``vision_messages`` answers go to ``~/vision_classification``, too.

    Configuring loads the models. A file that cannot be used is named in the log and in the
    diagnostics, and the others answer. With the parameter ``recalibration_trials`` the first
    known trials of each session correct the answers of each model, not its file.

    Attributes
    ----------
    answering : Answering or None
        The core, with its counters; None before the first configuration.
    """

    def __init__(self, node_name: str = 'tactile_classifier', **node_options: Any) -> None:
        super().__init__(node_name, ClassifierConfig, **node_options)
        self.answering: Answering | None = None
        self._publisher: RecordPublisher | None = None
        self._partial_publisher: RecordPublisher | None = None
        self._vision_publisher: RecordPublisher | None = None
        self._models_publisher: Any = None
        self._specifications: Any = None
        self._diagnostics: Diagnostics | None = None
        self._inputs: list[RecordSubscription] = []

    def set_up(self, config: ClassifierConfig) -> None:
        models = ModelSet.load(config.models, config.contact, config.recalibration_trials)
        answering = self.answering = Answering(models)
        self._publisher = self._add_publisher('~/classification')
        if config.vision_messages:
            self._vision_publisher = self.publish_records(
                vision_class(),
                '~/vision_classification',
                lambda result: vision_from_msg(classification_to_msg(result)),
                RESULTS,
            )
        self._specifications = self.create_subscription(
            FeatureSpecifications,
            'tactile_features/specifications',
            lambda message: self._warn(*answering.announce(specifications_from_msg(message))),
            LATEST,
        )
        self._subscribe('tactile_features/features', lambda w: self._on_features(answering, w))
        if models.partial_samples:
            self._partial_publisher = self._add_publisher('~/partial_classification')
            self._subscribe(
                'tactile_features/partial_features', lambda w: self._on_partial(answering, w)
            )
        self._diagnostics = Diagnostics(
            self,
            lambda: ', '.join(i.model_id for i in models.infos),
            lambda: self._assess(answering),
        )
        self._tell_models(models)

    def _tell_models(self, models: ModelSet) -> None:
        self._warn(*models.refused)
        for model in models.models:
            missing = ', '.join(model.spec.missing_parameters)
            self.get_logger().info(f'{model.model_id} knows {", ".join(model.labels)}')
            if missing:
                self._warn(
                    f'the file of {model.model_id} does not state {missing}: the parameters of '
                    'the feature node are taken for those that it was trained with'
                )
        # Not one of the lifecycle: the models are a state, also of an inactive node.
        self._models_publisher = self.create_publisher(ModelInfosMsg, '~/models', LATEST)
        stamp_ns = self.get_clock().now().nanoseconds
        self._models_publisher.publish(
            model_infos_to_msg(ModelInfos(models.infos, models.refused, stamp_ns))
        )

    def _warn(self, *sentences: str) -> None:
        for sentence in sentences:
            self.get_logger().warning(sentence)

    def _add_publisher(self, topic: str) -> RecordPublisher:
        return self.publish_records(Classification, topic, classification_to_msg, RESULTS)

    def _subscribe(self, topic: str, callback: Callable[[FeatureWindow], None]) -> None:
        self._inputs.append(
            self.subscribe_records(
                TactileFeatures,
                topic,
                callback,
                from_message=feature_window_from_msg,
                from_record=feature_window_from_record,
                profile=RESULTS,
            )
        )

    def tear_down(self) -> None:
        while self._inputs:
            self._inputs.pop().close()
        if self._specifications is not None:
            self.destroy_subscription(self._specifications)
            self._specifications = None
        if self._diagnostics is not None:
            self._diagnostics.close()
            self._diagnostics = None
        if self._models_publisher is not None:
            self.destroy_publisher(self._models_publisher)
            self._models_publisher = None
        for publisher in (self._publisher, self._partial_publisher, self._vision_publisher):
            if publisher is not None:
                publisher.close()
        self._publisher = self._partial_publisher = self._vision_publisher = None

    def _on_features(self, answering: Answering, window: FeatureWindow) -> None:
        self._answer(answering, window, self._publisher, self._vision_publisher)

    def _on_partial(self, answering: Answering, window: FeatureWindow) -> None:
        self._answer(answering, window, self._partial_publisher)

    def _answer(
        self, answering: Answering, window: FeatureWindow, *publishers: RecordPublisher | None
    ) -> None:
        if not self.is_active:
            return
        for result in answering.answer(window):
            for publisher in publishers:
                if publisher is not None:
                    publisher.publish(result)
        if answering.mismatch:
            self.get_logger().warning(answering.mismatch, throttle_duration_sec=LOG_PERIOD_S)
        for sentence in answering.take_news():
            self.get_logger().info(sentence)

    def _assess(self, answering: Answering) -> Health:
        models = answering.models
        faults = [each for each in (answering.mismatch, *models.unfed, *models.refused) if each]
        loaded = f'{len(models.models)} models are loaded'
        return Health(
            WARN if faults else OK,
            '; '.join(faults) or loaded,
            {**answering.values(), 'active': self.is_active},
        )


def main() -> int:
    """Run the node."""
    return run_node(TactileClassifierNode)
