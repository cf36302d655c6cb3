# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Conversion between results and ROS messages, including ``vision_msgs/Classification``."""

from __future__ import annotations

import dataclasses
from typing import Any

from tactile_classifier.errors import ClassifierError
from tactile_classifier.types import ModelInfo, ModelInfos, PredictionOutcome, WindowPrediction
from tactile_ros.errors import MessageError
from tactile_ros.message_classes import (
    copy_fields,
    enum_from_msg,
    header_to_msg,
    time_from_msg,
    time_to_msg,
)


def model_infos_to_msg(infos: ModelInfos) -> Any:
    """Convert a record to a tactile_msgs/ModelInfos message."""
    from tactile_msgs.msg import ModelInfo as ModelInfoMsg
    from tactile_msgs.msg import ModelInfos as ModelInfosMsg

    return ModelInfosMsg(
        header=header_to_msg(infos.stamp_ns),
        models=[
            ModelInfoMsg(**{**dataclasses.asdict(info), 'labels': list(info.labels)})
            for info in infos.models
        ],
        refused=list(infos.refused),
    )


def model_infos_from_msg(message: Any) -> ModelInfos:
    """Convert a ModelInfos message of rclpy or rosbags to a record."""
    return ModelInfos(
        models=tuple(
            copy_fields(info, ModelInfo, labels=tuple(info.labels)) for info in message.models
        ),
        refused=tuple(message.refused),
        stamp_ns=time_from_msg(message.header.stamp),
    )


def classification_to_msg(result: WindowPrediction) -> Any:
    """Convert a result to a tactile_msgs/Classification message."""
    from tactile_msgs.msg import Classification

    fields = dataclasses.asdict(result)
    end_ns = fields.pop('window_end_ns')
    return Classification(
        header=header_to_msg(end_ns, fields.pop('frame_id')),
        window_start=time_to_msg(fields.pop('window_start_ns')),
        window_end=time_to_msg(end_ns),
        outcome=int(fields.pop('outcome')),
        labels=list(fields.pop('labels')),
        scores=list(fields.pop('scores')),
        **fields,
    )


def classification_from_msg(message: Any) -> WindowPrediction:
    """Convert a Classification message of rclpy or rosbags to a result.

    Raises MessageError if the outcome is unknown, or the numbers of scores and labels differ.
    """
    if len(message.scores) not in (0, len(message.labels)):
        raise MessageError(
            f'scores has {len(message.scores)} entries and labels {len(message.labels)}; '
            'the numbers must be equal'
        )
    result: WindowPrediction = copy_fields(
        message,
        WindowPrediction,
        outcome=enum_from_msg(PredictionOutcome, 'outcome', message.outcome),
        labels=tuple(message.labels),
        scores=tuple(float(score) for score in message.scores),
        window_start_ns=time_from_msg(message.window_start),
        window_end_ns=time_from_msg(message.window_end),
        frame_id=message.header.frame_id,
    )
    return result


def vision_class() -> Any:
    """Return the class vision_msgs/Classification; raise ClassifierError if not installed."""
    try:
        from vision_msgs.msg import Classification
    except ImportError:
        raise ClassifierError(
            'the parameter vision_messages is set, but the package vision_msgs is not '
            'installed: sudo apt install ros-$ROS_DISTRO-vision-msgs'
        ) from None
    return Classification


def vision_from_msg(answer: Any) -> Any:
    """Convert to vision_msgs/Classification: labels with their scores, highest score first.

    If the object is unknown or the window has no features, the message has no results.
    """
    from vision_msgs.msg import ObjectHypothesis

    message = vision_class()(header=answer.header)
    if answer.outcome == PredictionOutcome.LABEL:
        ranked = sorted(zip(answer.labels, answer.scores, strict=True), key=lambda pair: -pair[1])
        message.results = [
            ObjectHypothesis(class_id=label, score=score) for label, score in ranked
        ]
    return message
