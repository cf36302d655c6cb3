# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Answers as ``vision_msgs/Classification``, where that package is installed."""

from __future__ import annotations

from typing import Any

from tactile_classifier.errors import ClassifierError
from tactile_classifier.records import Outcome


def vision_class() -> Any:
    """Return the class of the standard message.

    Raises
    ------
    ClassifierError
        When ``vision_msgs`` is not installed.
    """
    try:
        from vision_msgs.msg import Classification
    except ImportError:
        raise ClassifierError(
            'the parameter vision_messages is set, but the package vision_msgs is not '
            'installed: sudo apt install ros-$ROS_DISTRO-vision-msgs'
        ) from None
    return Classification


def vision_from_msg(answer: Any) -> Any:
    """Return the standard message for one of ours: labels with their scores, the best first.

    It cannot say why there is no answer: of an unknown touch, or a window without features,
    it has no results.
    """
    from vision_msgs.msg import ObjectHypothesis

    message = vision_class()(header=answer.header)
    if answer.outcome == Outcome.LABEL:
        ranked = sorted(zip(answer.labels, answer.scores, strict=True), key=lambda pair: -pair[1])
        message.results = [
            ObjectHypothesis(class_id=label, score=score) for label, score in ranked
        ]
    return message
