# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Conversion between results and ROS messages."""

from __future__ import annotations

import dataclasses
from typing import Any

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
