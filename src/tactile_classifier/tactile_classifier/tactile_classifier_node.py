# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The classifier as a ROS node: a `ModelSet` between topics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tactile_classifier.conversions import classification_to_msg, model_infos_to_msg
from tactile_classifier.model_file.model_set import ModelSet
from tactile_classifier.records import ClassificationResult, ClassifierConfig, ModelInfos, Outcome
from tactile_classifier.vision import vision_class, vision_from_msg
from tactile_features.conversions import (
    feature_window_from_msg,
    feature_window_from_record,
    specifications_from_msg,
)
from tactile_features.records import FeatureWindow
from tactile_features.records import Outcome as FeatureOutcome
from tactile_msgs.msg import Classification, FeatureSpecifications, TactileFeatures
from tactile_msgs.msg import ModelInfos as ModelInfosMsg
from tactile_ros.health.diagnostics import Diagnostics, Health, OK, WARN
from tactile_ros.node.polled_subscription import PolledSubscription
from tactile_ros.node.record_publisher import RecordPublisher
from tactile_ros.node.stage_node import StageNode
from tactile_ros.programs.node_group import run_node
from tactile_ros.qos import LATEST, RESULTS

FEATURE_TOPICS = ('tactile_features/features', 'tactile_features/partial_features')
SPECIFICATIONS_TOPIC = 'tactile_features/specifications'

LOG_PERIOD_S = 10.0


class ClassifierStage:
    """Windows in, answers of each model that fits out.

    Parameters
    ----------
    node : TactileClassifierNode
        Hosts the topics.
    config : ClassifierConfig

    Attributes
    ----------
    models : ModelSet
    window_count, answer_count, partial_count : int
        Full windows that came while the node was active; answers on them; answers on partial ones.
    ignored_count : int
        Full windows that no model is for.
    refused_count : int
        Answers, partial ones too, that only say why a window with features fits no model.

    Raises
    ------
    ModelFileError
        When none of the model files is usable.
    """

    def __init__(self, node: TactileClassifierNode, config: ClassifierConfig) -> None:
        self._node = node
        self.models = models = ModelSet.load(
            config.models, config.contact, config.recalibration_trials
        )
        log = node.get_logger()
        for model in models.models:
            log.info(f'{model.model_id} knows {", ".join(model.labels)}')
        for sentence in models.refused:
            log.error(sentence)
        self.window_count = self.answer_count = self.partial_count = 0
        self.ignored_count = self.refused_count = 0
        self._mismatch = ''
        self._recalibrated_with: dict[str, int] = {}
        self._decided_trials: dict[str, tuple[str, int]] = {}  # by model
        self._answers, self._partial_answers = (
            RecordPublisher(node, Classification, topic, classification_to_msg, RESULTS)
            for topic in ('~/classification', '~/partial_classification')
        )
        self._vision: RecordPublisher | None = None
        if config.vision_messages:
            self._vision = RecordPublisher(
                node,
                vision_class(),
                '~/vision_classification',
                lambda result: vision_from_msg(classification_to_msg(result)),
                RESULTS,
            )
        self._infos = node.create_publisher(ModelInfosMsg, '~/models', LATEST)  # a state
        now_ns = node.get_clock().now().nanoseconds
        self._infos.publish(model_infos_to_msg(ModelInfos(models.infos, models.refused, now_ns)))
        self._diagnostics = Diagnostics(node, self._list_models, self._assess)
        self._specifications = node.create_subscription(
            FeatureSpecifications,
            SPECIFICATIONS_TOPIC,
            lambda msg: models.set_specifications(
                wanted.spec for wanted in specifications_from_msg(msg).wanted
            ),
            LATEST,
        )
        self._windows: list[PolledSubscription] = []
        if not node.is_fed_by_calls:
            self._windows = [
                node.poll(
                    TactileFeatures,
                    topic,
                    lambda msg, _: self.add_window(feature_window_from_msg(msg)),
                    RESULTS,
                )
                for topic in FEATURE_TOPICS
            ]

    def start(self) -> None: ...

    def stop(self) -> None: ...

    def close(self) -> None:
        """Give the topics back."""
        self._diagnostics.close()
        for subscription in self._windows:
            self._node.unpoll(subscription)
        self._node.destroy_subscription(self._specifications)
        del self._specifications  # a circle would keep the models
        for publisher in (self._answers, self._partial_answers, self._vision):
            if publisher is not None:
                publisher.close()
        self._node.destroy_publisher(self._infos)

    def add_window(self, window: FeatureWindow) -> None:
        """Answer a window of features, while the node is active."""
        if not self._node.is_active:
            return
        results = self.models.classify(window)
        if not window.partial:
            self.window_count += 1
            self.answer_count += len(results)
            self.ignored_count += not results
        for result in results:
            self._note_mismatch(result, window)
            self._note_recalibration(result, window)
            if window.partial:
                self._partial_answers.publish(result)
                self.partial_count += 1
                self._note_decision(result)
                continue
            self._answers.publish(result)
            if self._vision is not None:
                self._vision.publish(result)

    def _note_mismatch(self, result: ClassificationResult, window: FeatureWindow) -> None:
        """Count a window that fits no model; tell it at once and then now and then."""
        is_refused = result.outcome == Outcome.NO_FEATURES and window.outcome == FeatureOutcome.OK
        self._mismatch = f'{result.model_id}: {result.reason}' if is_refused else ''
        if is_refused:
            self.refused_count += 1
            self._node.get_logger().warning(self._mismatch, throttle_duration_sec=LOG_PERIOD_S)

    def _note_recalibration(self, result: ClassificationResult, window: FeatureWindow) -> None:
        trials = result.recalibration_trials
        if trials != self._recalibrated_with.get(result.model_id, 0):
            self._recalibrated_with[result.model_id] = trials
            what = (
                f'recalibrated with {trials} known trials'
                if trials
                else 'as trained, until there are known trials'
            )
            self._node.get_logger().info(
                f'session "{window.session_id}": {result.model_id} {what}'
            )

    def _note_decision(self, result: ClassificationResult) -> None:
        """Log the first decided answer of each trial."""
        trial = (result.trial_id, result.window_start_ns)
        if result.decided and trial != self._decided_trials.get(result.model_id):
            self._decided_trials[result.model_id] = trial
            seconds = (result.window_end_ns - result.window_start_ns) / 1e9
            self._node.get_logger().info(
                f'{result.label} after {seconds:.2f} s of the window, '
                f'probability {max(result.scores):.3f} (trial {result.trial_id})'
            )

    def _list_models(self) -> str:
        return ', '.join(model.model_id for model in self.models.models)

    def _assess(self) -> Health:
        loaded = f'models loaded: {len(self.models.models)}'
        problems = [*self.models.refused, *self.models.unfed]
        problems += [self._mismatch] if self._mismatch else []
        return Health(
            WARN if problems else OK,
            '; '.join(problems) or loaded,
            {
                'windows': self.window_count,
                'answers': self.answer_count,
                'windows for others': self.ignored_count,
                'windows of another specification': self.refused_count,
                'answers on partial windows': self.partial_count,
                'recalibrated with trials': max(self._recalibrated_with.values(), default=0),
                'active': self._node.is_active,
            },
        )


class TactileClassifierNode(StageNode):
    """Publishes ``~/classification``: for each window, one answer of each model that fits.

    Answers on partial windows, while a window fills, go to ``~/partial_classification``; the
    first decided one of each trial goes to the log. With the parameter ``vision_messages``
    answers go to ``~/vision_classification``, too. The models are latched on ``~/models``.

    Configuring loads the models. A file that cannot be used is named, and the others run. With
    the parameter ``recalibration_trials`` the first known trials of each session correct the
    answers, not the files.
    """

    def __init__(self, node_name: str = 'tactile_classifier', **node_options: Any) -> None:
        super().__init__(node_name, ClassifierConfig, **node_options)

    def make_stage(self, config: ClassifierConfig) -> ClassifierStage:
        return ClassifierStage(self, config)

    @property
    def add_window(self) -> Callable[[FeatureWindow], None]:
        """The input for windows of the features of this process."""
        return self.input(
            FEATURE_TOPICS[0],
            lambda stage, window: stage.add_window(feature_window_from_record(window)),
        )


def main() -> int:
    """Run the node."""
    return run_node(TactileClassifierNode)
