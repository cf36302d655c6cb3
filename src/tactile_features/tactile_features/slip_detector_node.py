# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The slip detection as a ROS node: `SlipDetector` between topics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tactile_features.conversions import (
    check_record,
    event_from_msg,
    slip_to_msg,
    strain_block_from_msg,
)
from tactile_features.records import PHASE_ABORTED, PHASE_DONE, TrialEvent
from tactile_features.slip import SlipConfig, SlipDetector, SMALLEST_RATE_HZ
from tactile_msgs.msg import Slip, StrainBlock
from tactile_msgs.msg import TrialEvent as TrialEventMsg
from tactile_ros.health import Diagnostics, Health, OK, WARN
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_ros.stages import Stage, StageNode
from tactile_ros.strain import StrainBlock as StrainRecord

STRAIN_TOPIC = 'tendon_sensor/strain'
EVENT_TOPICS = ('trial_runner/events', 'tactile_features/detected_events')
"""Topics of trial events; the latest event of either counts."""


class SlipStage(Stage):
    """Samples in, slips out: ``~/slip``.

    It listens from its beginning, so that it knows the noise when the node is activated.
    """

    def __init__(self, node: SlipDetectorNode, config: SlipConfig) -> None:
        self._node = node
        self._config = config
        self.detector = SlipDetector(config)
        self.trial_id = ''
        self._block_count = self._assessed_blocks = self._slip_count = 0
        self._publisher = node.create_lifecycle_publisher(Slip, '~/slip', RESULTS)
        self._diagnostics = Diagnostics(node, lambda: '', self._assess)
        topics = EVENT_TOPICS[:1] if node.is_fed_by_calls else EVENT_TOPICS
        self._events = [
            node.create_subscription(
                TrialEventMsg, topic, lambda msg: self.add_event(event_from_msg(msg)), EVENTS
            )
            for topic in topics
        ]
        node.listen(
            StrainBlock,
            STRAIN_TOPIC,
            lambda msg: self.add_block(strain_block_from_msg(msg)),
            STREAM,
        )

    def close(self) -> None:
        """Give the topics back."""
        self._diagnostics.close()
        for subscription in self._events:
            self._node.destroy_subscription(subscription)
        self._events.clear()
        self._node.destroy_lifecycle_publisher(self._publisher)

    def add_event(self, event: TrialEvent) -> None:
        """Take in the phase of a trial, whose name is passed on."""
        has_ended = event.phase in (PHASE_DONE, PHASE_ABORTED)
        self.trial_id = '' if has_ended else event.trial_id

    def add_block(self, block: StrainRecord) -> None:
        """Take in samples."""
        slips = self.detector.add(block)
        self._block_count += 1
        for slip in slips:
            self._slip_count += 1
            self._publisher.publish(slip_to_msg(slip, self._config, self.trial_id))

    def _assess(self) -> Health:
        is_fed = self._block_count > self._assessed_blocks
        self._assessed_blocks = self._block_count
        rate_hz, fault = self.detector.rate_hz, ''
        if not is_fed:
            fault = f'no samples on {STRAIN_TOPIC}'
        elif rate_hz < SMALLEST_RATE_HZ:
            fault = f'the samples come at {rate_hz:g} Hz; slip needs {SMALLEST_RATE_HZ:g} Hz'
        return Health(
            WARN if fault else OK,
            fault or 'samples come in',
            {
                'blocks': self._block_count,
                'slips': self._slip_count,
                'active': self._node.is_active,
            },
        )


class SlipDetectorNode(StageNode):
    """Publishes ``~/slip`` when a held object begins to slide.

    It needs no trial; when one is under way, its name is passed on, whether a trial runner
    tells of it or the feature node found it in the tension.
    """

    def __init__(self, node_name: str = 'slip_detector', **node_options: Any) -> None:
        super().__init__(node_name, SlipConfig, **node_options)

    def make_stage(self, config: SlipConfig) -> SlipStage:
        return SlipStage(self, config)

    @property
    def add_block(self) -> Callable[[StrainRecord], None]:
        """The input for blocks of the sensor of this process."""
        return self.input(STRAIN_TOPIC, lambda stage, block: stage.add_block(check_record(block)))

    @property
    def add_event(self) -> Callable[[TrialEvent], None]:
        """The input for events that the features of this process have found."""
        return self.input(EVENT_TOPICS[1], lambda stage, event: stage.add_event(event))
