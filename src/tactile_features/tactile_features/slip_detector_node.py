# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node around `SlipDetector`."""

from __future__ import annotations

from typing import Any

from tactile_features.conversions import (
    event_from_msg,
    slip_to_msg,
    strain_block_from_msg,
    strain_block_from_record,
)
from tactile_features.records import PHASE_ABORTED, PHASE_DONE
from tactile_features.slip import SlipConfig, SlipDetector, SMALLEST_RATE_HZ
from tactile_msgs.msg import Slip, StrainBlock, TrialEvent
from tactile_ros.bus.data_node import DataNode
from tactile_ros.bus.local_bus import RecordSubscription
from tactile_ros.health.diagnostics import Diagnostics, Health, OK, WARN
from tactile_ros.programs.node_group import run_node
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_ros.strain import StrainBlock as StrainRecord

EVENT_TOPICS = ('trial_runner/events', 'tactile_features/detected_events')
"""Topics of trial events; the latest event of either counts."""


class SlipDetectorNode(DataNode):
    """Publishes ``~/slip`` when a held object begins to slide.

    It needs no trial; when one is under way, its name is passed on, whether a trial runner
    tells of it or the feature node found it in the tension. It listens as soon as it is
    configured, so that it knows the noise when it is activated.

    Attributes
    ----------
    detector : SlipDetector or None
        The core; None before the first configuration.
    trial_id : str
        Trial under way; empty outside a trial.
    """

    def __init__(self, node_name: str = 'slip_detector', **node_options: Any) -> None:
        super().__init__(node_name, SlipConfig, **node_options)
        self.detector: SlipDetector | None = None
        self._publisher: Any = None
        self._strain: RecordSubscription | None = None
        self._subscriptions_made: list[Any] = []
        self._diagnostics: Diagnostics | None = None
        self._block_count = self._assessed_blocks = self._slip_count = 0
        self.trial_id = ''

    def set_up(self, config: SlipConfig) -> None:
        detector = self.detector = SlipDetector(config)
        self.trial_id = ''
        self._publisher = self.create_lifecycle_publisher(Slip, '~/slip', RESULTS)
        self._strain = self.subscribe_records(
            StrainBlock,
            'tendon_sensor/strain',
            lambda block: self._on_block(detector, block),
            from_message=strain_block_from_msg,
            from_record=strain_block_from_record,
            profile=STREAM,
        )
        self._subscriptions_made = [
            self.create_subscription(TrialEvent, topic, self._on_event, EVENTS)
            for topic in EVENT_TOPICS
        ]
        self._diagnostics = Diagnostics(self, lambda: '', self._assess)

    def tear_down(self) -> None:
        if self._diagnostics is not None:
            self._diagnostics.close()
            self._diagnostics = None
        if self._strain is not None:
            self._strain.close()
            self._strain = None
        for subscription in self._subscriptions_made:
            self.destroy_subscription(subscription)
        self._subscriptions_made = []
        if self._publisher is not None:
            self.destroy_lifecycle_publisher(self._publisher)
            self._publisher = None

    def _on_event(self, msg: Any) -> None:
        event = event_from_msg(msg)
        has_ended = event.phase in (PHASE_DONE, PHASE_ABORTED)
        self.trial_id = '' if has_ended else event.trial_id

    def _on_block(self, detector: SlipDetector, block: StrainRecord) -> None:
        slips = detector.add(block)
        self._block_count += 1
        for slip in slips:
            self._slip_count += 1
            self._publisher.publish(slip_to_msg(slip, self.config, self.trial_id))

    def _assess(self) -> Health:
        is_fed = self._block_count > self._assessed_blocks
        self._assessed_blocks = self._block_count
        rate_hz = self.detector.rate_hz if self.detector is not None else 0.0
        fault = ''
        if not is_fed:
            fault = 'no samples on tendon_sensor/strain'
        elif rate_hz < SMALLEST_RATE_HZ:
            fault = f'the samples come at {rate_hz:g} Hz; slip needs {SMALLEST_RATE_HZ:g} Hz'
        return Health(
            WARN if fault else OK,
            fault or 'samples come in',
            {'blocks': self._block_count, 'slips': self._slip_count, 'active': self.is_active},
        )


def main() -> int:
    """Run the node."""
    return run_node(SlipDetectorNode)
