# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS node that classifies windows of features with a `ModelSet`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tactile_classifier.config import ClassifierConfig
from tactile_classifier.conversions import classification_to_msg, model_infos_to_msg
from tactile_classifier.model_set import ModelSet
from tactile_classifier.types import ModelInfos
from tactile_features.conversions import (
    feature_window_from_msg,
    feature_window_from_record,
    specifications_from_msg,
)
from tactile_features.spec import FeatureSpecifications as SpecificationsRecord
from tactile_features.types import FeatureWindow
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
    """Stage that classifies each window of features with all models that fit it.

    If no model file is usable, the constructor raises ModelFileError.
    """

    def __init__(self, node: TactileClassifierNode, config: ClassifierConfig) -> None:
        self._node = node
        self.models = models = ModelSet.load(config.models, config.contact)
        self._log_models()
        self._publisher = RecordPublisher(
            node, Classification, '~/classification', classification_to_msg, RESULTS
        )
        # A lifecycle publisher could not publish the models while the node is inactive.
        self._infos = node.create_publisher(ModelInfosMsg, '~/models', LATEST)
        now_ns = node.get_clock().now().nanoseconds
        self._infos.publish(model_infos_to_msg(ModelInfos(models.infos, models.refused, now_ns)))
        self._diagnostics = Diagnostics(
            node, lambda: ', '.join(info.model_id for info in models.infos), self._assess
        )
        self._specifications = node.create_subscription(
            FeatureSpecifications,
            SPECIFICATIONS_TOPIC,
            lambda msg: self._set_specifications(specifications_from_msg(msg)),
            LATEST,
        )
        node.listen(
            TactileFeatures,
            FEATURES_TOPIC,
            lambda msg: self.add_window(feature_window_from_msg(msg)),
            RESULTS,
        )

    def close(self) -> None:
        """Destroy publishers and subscriptions."""
        self._diagnostics.close()
        self._node.destroy_subscription(self._specifications)
        del self._specifications  # break a reference cycle that keeps the models in memory
        self._publisher.close()
        self._node.destroy_publisher(self._infos)

    def add_window(self, window: FeatureWindow) -> None:
        """Classify a window of features if the node is active."""
        if not self._node.is_active:
            return
        for result in self.models.classify(window):
            self._publisher.publish(result)
        log = self._node.get_logger()
        if (mismatch := self.models.mismatch) is not None:
            log.warning(plain_text(mismatch), throttle_duration_sec=LOG_PERIOD_S)

    def _set_specifications(self, announced: SpecificationsRecord) -> None:
        self.models.set_specifications(announced.specs)
        self._warn(*self.models.unfed)

    def _log_models(self) -> None:
        self._warn(*self.models.refused)
        for model in self.models.models:
            missing = ', '.join(model.spec.missing_parameters)
            labels = ', '.join(model.labels)
            self._node.get_logger().info(f'loaded {model.model_id}; labels: {labels}')
            if missing:
                self._warn(
                    f'the file of {model.model_id} does not contain {missing}: the parameters of '
                    'the feature node are assumed to equal the training parameters'
                )

    def _warn(self, *sentences: str) -> None:
        for sentence in sentences:
            self._node.get_logger().warning(sentence)

    def _assess(self) -> Health:
        models = self.models
        faults = [*filter(None, [models.mismatch]), *models.unfed, *models.refused]
        return Health(
            WARN if faults else OK,
            '; '.join(faults) or f'loaded models: {len(models.models)}',
            {
                **models.counts,
                'models': len(models.models),
                'refused model files': len(models.refused),
                'active': self._node.is_active,
            },
        )


class TactileClassifierNode(StageNode):
    """Publishes ``~/classification``: for each window, one result of each model that fits.

    A model of early windows returns its result during the phase. It has its own probabilities and
    its own threshold for unknown objects. The models are latched on ``~/models``.

    Models are loaded when the node is configured. If a file cannot be used, this is reported, and
    the other models are used.
    """

    poll_s = 0.02  # there are only a few windows per trial

    def __init__(self, node_name: str = 'tactile_classifier', **node_options: Any) -> None:
        super().__init__(node_name, ClassifierConfig, **node_options)

    def make_stage(self, config: ClassifierConfig) -> ClassifierStage:
        return ClassifierStage(self, config)

    @property
    def models(self) -> ModelSet | None:
        """The models with their counters; None if the node is not configured."""
        stage: ClassifierStage | None = self.stage
        return stage.models if stage is not None else None

    @property
    def add_window(self) -> Callable[[FeatureWindow], None]:
        """Input for windows from a feature stage in the same process."""
        return self.input(
            FEATURES_TOPIC,
            lambda stage, window: stage.add_window(feature_window_from_record(window)),
        )


def main() -> int:
    """Run the node."""
    return run_node(TactileClassifierNode)
