# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node around `TrialFeatureExtractor`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
import dataclasses
import time
from typing import Any

from tactile_features.config import FeaturesNodeConfig
from tactile_features.conversions import (
    event_from_msg,
    event_to_msg,
    feature_window_to_msg,
    specifications_to_msg,
    strain_block_from_msg,
    strain_block_from_record,
)
from tactile_features.extraction.extractor import TrialFeatureExtractor
from tactile_features.extraction.sample_timeout import SampleTimeout
from tactile_features.model_contract import FeaturePlan, plan_features
from tactile_features.records import FeatureWindow, Outcome, PHASE_ABORTED
from tactile_features.spec import FeatureSpecifications
from tactile_msgs.msg import (
    FeatureSpecifications as FeatureSpecificationsMsg,
)
from tactile_msgs.msg import (
    StrainBlock,
    TactileFeatures,
    TrialEvent,
)
from tactile_ros.bus.data_node import DataNode
from tactile_ros.bus.local_bus import RecordSubscription
from tactile_ros.bus.worker import Periodic
from tactile_ros.health.diagnostics import Diagnostics, Health, OK, WARN
from tactile_ros.programs.node_group import run_node
from tactile_ros.qos import EVENTS, LATEST, RESULTS, STREAM
from tactile_ros.strain import StrainBlock as StrainRecord

WATCH_PERIOD_S = 0.25

HISTORY_S = 5.0
"""Latched events come within this time, or are taken for new ones."""


class TactileFeaturesNode(DataNode):
    """Publishes ``~/features`` for the trials seen on the strain and event topics.

    Windows that still fill go to ``~/partial_features``, where nobody takes them for
    finished ones; phases found in the signal go to ``~/detected_events``. The specifications of
    all of them are on ``~/specifications``, latched, from the configuration on.

    With the parameter ``models`` the features are those that the model files need. A file that
    cannot be used is named in the log and in the diagnostics; the others count.

    A window whose samples do not come is refused after ``samples_timeout_s``, also while
    nothing at all comes any more.

    It listens as soon as it is configured, so that a trial under way at activation
    is whole, and publishes while it is active.

    Attributes
    ----------
    extractor : TrialFeatureExtractor or None
        The core, with its counters; None before the first configuration.
    plan : FeaturePlan
        The features that the model files need, and the files that are refused.
    """

    def __init__(self, node_name: str = 'tactile_features', **node_options: Any) -> None:
        super().__init__(node_name, FeaturesNodeConfig, **node_options)
        self.extractor: TrialFeatureExtractor | None = None
        self.plan = FeaturePlan()
        self._publisher: Any = None
        self._specifications: Any = None
        self._partial_publisher: Any = None
        self._event_publisher: Any = None
        self._strain: RecordSubscription | None = None
        self._events: Any = None
        self._watch: Periodic | None = None
        self._diagnostics: Diagnostics | None = None
        self._window_counts: Counter[Outcome] = Counter()
        self._assessed_blocks = 0
        self._configured_ns, self._configured_s = 0, 0.0

    def set_up(self, config: FeaturesNodeConfig) -> None:
        plan = self.plan = plan_features(config.shared(), config.models, config.contact)
        for sentence in plan.refused:
            self.get_logger().warning(sentence)
        if plan.overruled:
            self.get_logger().info(f'the models decide: {", ".join(plan.overruled)}')
        extractor = self.extractor = TrialFeatureExtractor(config.shared(), plan.wanted)
        self._configured_ns, self._configured_s = time.time_ns(), time.monotonic()
        self._publisher = self.publish_records(
            TactileFeatures, '~/features', feature_window_to_msg, RESULTS
        )
        self._partial_publisher = self.publish_records(
            TactileFeatures, '~/partial_features', feature_window_to_msg, RESULTS
        )
        self._event_publisher = self.create_lifecycle_publisher(
            TrialEvent, '~/detected_events', EVENTS
        )
        # Not one of the lifecycle: what would be computed is a state, also of an inactive node.
        self._specifications = self.create_publisher(
            FeatureSpecificationsMsg, '~/specifications', LATEST
        )
        self._specifications.publish(
            specifications_to_msg(
                FeatureSpecifications(
                    extractor.wanted,
                    dataclasses.asdict(extractor.config),
                    self.get_clock().now().nanoseconds,
                )
            )
        )
        self._strain = self.subscribe_records(
            StrainBlock,
            'tendon_sensor/strain',
            lambda block: self._on_block(extractor, block),
            from_message=strain_block_from_msg,
            from_record=strain_block_from_record,
            profile=STREAM,
        )
        self._events = self.create_subscription(
            TrialEvent,
            'trial_runner/events',
            lambda msg, info: self._on_event(extractor, msg, info['source_timestamp']),
            EVENTS,
        )
        timeout = SampleTimeout(extractor)
        self._watch = self.call_every(
            WATCH_PERIOD_S,
            lambda: self._publish(extractor.time_out()) if timeout.is_over() else None,
        )
        self._diagnostics = Diagnostics(self, lambda: '', self._assess)

    def stop(self) -> None:
        # After an interrupt there is no one left to publish to.
        if self.extractor is not None and self.context.ok():
            self._publish(self.extractor.finish())

    def tear_down(self) -> None:
        if self._diagnostics is not None:
            self._diagnostics.close()
            self._diagnostics = None
        if self._watch is not None:
            self._watch.cancel()
            self._watch = None
        if self._strain is not None:
            self._strain.close()
            self._strain = None
        if self._events is not None:
            self.destroy_subscription(self._events)
            self._events = None
        for publisher in (self._publisher, self._partial_publisher):
            if publisher is not None:
                publisher.close()
        if self._event_publisher is not None:
            self.destroy_lifecycle_publisher(self._event_publisher)
        if self._specifications is not None:
            self.destroy_publisher(self._specifications)
            self._specifications = None
        self._publisher = self._partial_publisher = self._event_publisher = None

    def _on_event(self, extractor: TrialFeatureExtractor, msg: Any, published_ns: int) -> None:
        """Take in an event. After a start the latched ones of earlier trials come first."""
        is_first = time.monotonic() - self._configured_s < HISTORY_S
        is_past = is_first and published_ns < self._configured_ns
        self._publish(extractor.add_event(event_from_msg(msg), is_past=is_past))

    def _on_block(self, extractor: TrialFeatureExtractor, block: StrainRecord) -> None:
        windows = extractor.add_block(block)
        for event in extractor.take_detected_events():
            if event.phase == PHASE_ABORTED:
                self.get_logger().warning(f'trial {event.trial_id}: {event.message}')
            self._event_publisher.publish(event_to_msg(event))
        self._publish(windows)

    def _publish(self, windows: Iterable[FeatureWindow]) -> None:
        for window in windows:
            if window.outcome != Outcome.OK:
                self.get_logger().warning(
                    f'no features of trial {window.trial_id}: {window.reason}'
                )
            if not window.partial:
                self._window_counts[window.outcome] += 1
            publisher = self._partial_publisher if window.partial else self._publisher
            publisher.publish(window)

    def _assess(self) -> Health:
        extractor = self.extractor
        blocks = extractor.block_count if extractor is not None else 0
        is_fed, self._assessed_blocks = blocks > self._assessed_blocks, blocks
        windows, refused = self._window_counts, self.plan.refused
        sentences = ['samples come in' if is_fed else 'no samples on tendon_sensor/strain']
        return Health(
            OK if is_fed and not refused else WARN,
            '; '.join([*sentences, *refused]),
            {
                'specifications': len(extractor.specifications) if extractor is not None else 0,
                'refused model files': len(refused),
                'blocks': blocks,
                'events': extractor.event_count if extractor is not None else 0,
                'windows': sum(windows.values()),
                'windows without features': sum(windows.values()) - windows[Outcome.OK],
                'active': self.is_active,
            },
        )


def main() -> int:
    """Run the node."""
    return run_node(TactileFeaturesNode)
