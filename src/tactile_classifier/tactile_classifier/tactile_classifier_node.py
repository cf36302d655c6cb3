# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The classifier as a ROS node: a `ModelSet` between topics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tactile_classifier.answering import Answering, ModelSet
from tactile_classifier.conversions import (
    classification_to_msg,
    model_infos_to_msg,
    vision_class,
    vision_from_msg,
)
from tactile_classifier.records import ClassifierConfig, ModelInfos
from tactile_features.conversions import (
    feature_window_from_msg,
    feature_window_from_record,
    specifications_from_msg,
)
from tactile_features.records import FeatureWindow
from tactile_msgs.msg import Classification, FeatureSpecifications, TactileFeatures
from tactile_msgs.msg import ModelInfos as ModelInfosMsg
from tactile_ros.errors import plain_text
from tactile_ros.health import Diagnostics, Health, OK, WARN
from tactile_ros.node_group import run_node
from tactile_ros.qos import LATEST, RESULTS
from tactile_ros.stages import RecordPublisher, Stage, StageNode

FEATURES_TOPIC = 'tactile_features/features'
SPECIFICATIONS_TOPIC = 'tactile_features/specifications'

LOG_PERIOD_S = 10.0


class ClassifierStage(Stage):
    """Windows in, answers of each model that fits out.

    ``answering`` is the core, with its counters. Raises ModelFileError when none of the model
    files is usable.
    """

    def __init__(self, node: TactileClassifierNode, config: ClassifierConfig) -> None:
        self._node = node
        vision = vision_class() if config.vision_messages else None
        models = ModelSet.load(config.models, config.contact)
        self.answering = Answering(models)
        self._log_models(models)
        self._publishers = [
            RecordPublisher(
                node, Classification, '~/classification', classification_to_msg, RESULTS
            )
        ]
        if vision is not None:
            self._publishers.append(
                RecordPublisher(
                    node,
                    vision,
                    '~/vision_classification',
                    lambda result: vision_from_msg(classification_to_msg(result)),
                    RESULTS,
                )
            )
        # A plain publisher: the models are a state, also of an inactive node.
        self._infos = node.create_publisher(ModelInfosMsg, '~/models', LATEST)
        now_ns = node.get_clock().now().nanoseconds
        self._infos.publish(model_infos_to_msg(ModelInfos(models.infos, models.refused, now_ns)))
        self._diagnostics = Diagnostics(
            node, lambda: ', '.join(info.model_id for info in models.infos), self._assess
        )
        self._specifications = node.create_subscription(
            FeatureSpecifications,
            SPECIFICATIONS_TOPIC,
            lambda msg: self._warn(*self.answering.announce(specifications_from_msg(msg))),
            LATEST,
        )
        node.listen(
            TactileFeatures,
            FEATURES_TOPIC,
            lambda msg: self.add_window(feature_window_from_msg(msg)),
            RESULTS,
        )

    def close(self) -> None:
        """Give the topics back."""
        self._diagnostics.close()
        self._node.destroy_subscription(self._specifications)
        del self._specifications  # a circle would keep the models
        for publisher in self._publishers:
            publisher.close()
        self._node.destroy_publisher(self._infos)

    def add_window(self, window: FeatureWindow) -> None:
        """Answer a window of features, while the node is active."""
        if not self._node.is_active:
            return
        for result in self.answering.answer(window):
            for publisher in self._publishers:
                publisher.publish(result)
        log = self._node.get_logger()
        if self.answering.mismatch:
            log.warning(plain_text(self.answering.mismatch), throttle_duration_sec=LOG_PERIOD_S)

    def _log_models(self, models: ModelSet) -> None:
        self._warn(*models.refused)
        for model in models.models:
            missing = ', '.join(model.spec.missing_parameters)
            self._node.get_logger().info(f'{model.model_id} knows {", ".join(model.labels)}')
            if missing:
                self._warn(
                    f'the file of {model.model_id} does not state {missing}: the parameters of '
                    'the feature node are taken for those that it was trained with'
                )

    def _warn(self, *sentences: str) -> None:
        for sentence in sentences:
            self._node.get_logger().warning(sentence)

    def _assess(self) -> Health:
        models, mismatch = self.answering.models, self.answering.mismatch
        faults = [each for each in (mismatch, *models.unfed, *models.refused) if each]
        return Health(
            WARN if faults else OK,
            '; '.join(faults) or f'{len(models.models)} models are loaded',
            {**self.answering.values(), 'active': self._node.is_active},
        )


class TactileClassifierNode(StageNode):
    """Publishes ``~/classification``: for each window, one answer of each model that fits.

    A model of early windows answers while the phase goes on, with probabilities and an unknown of
    its own. With the parameter ``vision_messages`` answers go to ``~/vision_classification``, too.
    The models are latched on ``~/models``.

    Configuring loads the models. A file that cannot be used is named, and the others run.
    """

    poll_s = 0.02  # windows come a few times a trial

    def __init__(self, node_name: str = 'tactile_classifier', **node_options: Any) -> None:
        super().__init__(node_name, ClassifierConfig, **node_options)

    def make_stage(self, config: ClassifierConfig) -> ClassifierStage:
        return ClassifierStage(self, config)

    @property
    def answering(self) -> Answering | None:
        """The core; None while the node is not configured."""
        stage: ClassifierStage | None = self.stage
        return stage.answering if stage is not None else None

    @property
    def add_window(self) -> Callable[[FeatureWindow], None]:
        """The input for windows of the features of this process."""
        return self.input(
            FEATURES_TOPIC,
            lambda stage, window: stage.add_window(feature_window_from_record(window)),
        )


def main() -> int:
    """Run the node."""
    return run_node(TactileClassifierNode)
