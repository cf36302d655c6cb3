# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Conversion between results and ROS messages, including ``vision_msgs/Classification``."""

from __future__ import annotations

import dataclasses
from typing import Any

from tactile_classifier.errors import ClassifierError
from tactile_classifier.types import ModelInfo, ModelInfos, PredictionOutcome, WindowPrediction
from tactile_ros.errors import MessageError
from tactile_ros.message_classes import time_to_msg


def _to_ns(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def model_infos_to_msg(infos: ModelInfos) -> Any:
    """Convert a record to a tactile_msgs/ModelInfos message."""
    from std_msgs.msg import Header

    from tactile_msgs.msg import ModelInfo as ModelInfoMsg
    from tactile_msgs.msg import ModelInfos as ModelInfosMsg

    return ModelInfosMsg(
        header=Header(stamp=time_to_msg(infos.stamp_ns)),
        models=[
            ModelInfoMsg(**{**dataclasses.asdict(info), 'labels': list(info.labels)})
            for info in infos.models
        ],
        refused=list(infos.refused),
    )


def model_infos_from_msg(message: Any) -> ModelInfos:
    """Convert a ModelInfos message of rclpy or rosbags to a record."""
    names = [field.name for field in dataclasses.fields(ModelInfo)]
    return ModelInfos(
        models=tuple(
            ModelInfo(
                **{**{name: getattr(info, name) for name in names}, 'labels': tuple(info.labels)}
            )
            for info in message.models
        ),
        refused=tuple(message.refused),
        stamp_ns=_to_ns(message.header.stamp),
    )


_CONVERTED = ('outcome', 'labels', 'scores', 'frame_id')
_TIMES = ('window_start_ns', 'window_end_ns')
_AS_THEY_ARE = tuple(
    field.name
    for field in dataclasses.fields(WindowPrediction)
    if field.name not in (*_CONVERTED, *_TIMES)
)
"""Fields with the same name and type in result and message."""


def classification_to_msg(result: WindowPrediction) -> Any:
    """Convert a result to a tactile_msgs/Classification message."""
    from std_msgs.msg import Header

    from tactile_msgs.msg import Classification

    return Classification(
        header=Header(stamp=time_to_msg(result.window_end_ns), frame_id=result.frame_id),
        outcome=int(result.outcome),
        labels=list(result.labels),
        scores=list(result.scores),
        window_start=time_to_msg(result.window_start_ns),
        window_end=time_to_msg(result.window_end_ns),
        **{name: getattr(result, name) for name in _AS_THEY_ARE},
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
    return WindowPrediction(
        outcome=_read_outcome(message.outcome),
        labels=tuple(message.labels),
        scores=tuple(float(score) for score in message.scores),
        window_start_ns=_to_ns(message.window_start),
        window_end_ns=_to_ns(message.window_end),
        frame_id=message.header.frame_id,
        **{name: getattr(message, name) for name in _AS_THEY_ARE},
    )


def _read_outcome(value: Any) -> PredictionOutcome:
    try:
        return PredictionOutcome(value)
    except ValueError:
        names = ', '.join(f'{outcome.value} ({outcome.name})' for outcome in PredictionOutcome)
        raise MessageError(f'outcome is {value}; it must be one of {names}') from None


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
