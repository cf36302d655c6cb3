# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS node that computes features with `TrialFeatureExtractor`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import dataclasses
import time
from typing import Any

from tactile_features.config import FeatureConfig, FeaturesNodeConfig, round_rate
from tactile_features.conversions import (
    check_record,
    event_from_msg,
    event_to_msg,
    feature_window_to_msg,
    specifications_to_msg,
    strain_block_from_msg,
)
from tactile_features.errors import FeatureError
from tactile_features.extraction.extractor import SampleTimeout, TrialFeatureExtractor
from tactile_features.feature_sets.feature_set import RATE_TOLERANCE
from tactile_features.model_contract import plan_features
from tactile_features.spec import FeatureSpecifications
from tactile_features.types import FeatureWindow, PHASE_ABORTED, TrialEvent, WindowOutcome
from tactile_msgs.msg import FeatureSpecifications as FeatureSpecificationsMsg
from tactile_msgs.msg import StrainBlock, TactileFeatures
from tactile_msgs.msg import TrialEvent as TrialEventMsg
from tactile_ros.errors import MessageError, plain_text
from tactile_ros.health import Diagnostics, Health, OK, WARN
from tactile_ros.qos import EVENTS, LATEST, RESULTS, STREAM
from tactile_ros.stages import ignore, RecordPublisher, Stage, StageNode
from tactile_ros.strain import StrainBlock as StrainRecord

STRAIN_TOPIC = 'tendon_sensor/strain'

WATCH_PERIOD_S = 0.5

TRIAL_POLL_S, IDLE_POLL_S = 0.01, 0.1
"""Periods of polling the samples during a trial and between trials [s]. Windows become complete
only during a trial. Between trials, samples only fill the buffers."""

HISTORY_S = 5.0
"""Latched events arrive within this time after the start [s]. Later events count as new."""


class FeaturesStage(Stage):
    """Stage that turns samples and events into windows of features.

    The stage subscribes when it is created. If a trial has already begun when the node is
    activated, its samples are therefore complete. While the node is active, ``emit`` is called
    with each window. If parameters are invalid, or no model is usable, the constructor raises
    `FeatureError`.
    """

    def __init__(
        self,
        node: TactileFeaturesNode,
        config: FeaturesNodeConfig,
        emit: Callable[[FeatureWindow], object],
    ) -> None:
        self._node = node
        self._emit = emit
        shared = config.shared()
        plan = plan_features(shared, config.models, config.contact)
        self.extractor = TrialFeatureExtractor(shared, plan.specs)
        self._refused = plan.refused
        # Events that came before the first samples; None after the rate of the sensor is known.
        self._early_events: list[tuple[TrialEvent, bool]] | None = []
        self._follows_sensor = not plan.specs and shared.rate_hz == FeatureConfig.rate_hz
        for sentence in plan.refused:
            node.get_logger().warning(sentence)
        if plan.overruled:
            node.get_logger().info(f'parameters from the models: {", ".join(plan.overruled)}')
        self._begun_ns, self._begun_s = time.time_ns(), time.monotonic()
        self._assessed_blocks = 0
        self._features = RecordPublisher(
            node, TactileFeatures, '~/features', feature_window_to_msg, RESULTS
        )
        self._detected = node.create_lifecycle_publisher(
            TrialEventMsg, '~/detected_events', EVENTS
        )
        # The specifications are latched, because other nodes need them when they start.
        self._specifications = node.create_publisher(
            FeatureSpecificationsMsg, '~/specifications', LATEST
        )
        if not self._follows_sensor:
            self._announce()
        self._timeout = SampleTimeout(self.extractor)
        self._watching = node.call_every(WATCH_PERIOD_S, self._watch)
        self._diagnostics = Diagnostics(node, lambda: '', self._assess)
        self._events = node.create_subscription(
            TrialEventMsg,
            'trial_runner/events',
            lambda msg, info: self._on_event(event_from_msg(msg), info['source_timestamp']),
            EVENTS,
        )
        node.listen(
            StrainBlock,
            STRAIN_TOPIC,
            lambda msg: self.add_block(strain_block_from_msg(msg)),
            STREAM,
        )

    def stop(self) -> None:
        """Publish the windows that still wait for samples."""
        if self._node.context.ok():  # after an interrupt, nothing can be published
            self._publish(self.extractor.finish())

    def close(self) -> None:
        """Destroy the subscriptions, publishers and timers."""
        node = self._node
        self._watching.cancel()
        self._diagnostics.close()
        node.destroy_subscription(self._events)
        del self._events, self._timeout  # reference cycles would keep the samples alive
        self._features.close()
        node.destroy_lifecycle_publisher(self._detected)
        node.destroy_publisher(self._specifications)

    def add_block(self, block: StrainRecord) -> None:
        """Process a block of samples."""
        if self._early_events is not None and block.period_ns > 0:
            self._meet_sensor(round_rate(1e9 / block.period_ns), self._early_events)
        windows = self.extractor.add_block(block)
        for event in self.extractor.take_detected_events():
            if event.phase == PHASE_ABORTED:
                self._node.get_logger().warning(f'trial {event.trial_id}: {event.message}')
            self._detected.publish(event_to_msg(event))
        if windows:
            self._publish(windows)
        self._choose_period()

    def _choose_period(self) -> None:
        self._node.poll_every(IDLE_POLL_S if self.extractor.is_idle else TRIAL_POLL_S)

    def _meet_sensor(self, sensor_hz: float, events: Sequence[tuple[TrialEvent, bool]]) -> None:
        """Use the rate of the sensor [Hz], or warn that the models need another rate."""
        self._early_events = None
        logger = self._node.get_logger()
        rates = sorted({spec.rate_hz for spec in self.extractor.specifications})
        others = [hz for hz in rates if abs(sensor_hz / hz - 1.0) > RATE_TOLERANCE]
        if others and self._follows_sensor:
            try:
                config = self.extractor.config.at_rate(sensor_hz)
                self.extractor = TrialFeatureExtractor(config)
            except FeatureError as error:
                logger.warning(f'no features at the {sensor_hz:g} Hz of the sensor: {error}')
            else:
                logger.info(f'features at {sensor_hz:g} Hz, the rate of the sensor')
                self._timeout = SampleTimeout(self.extractor)
                for event, is_past in events:
                    self._publish(self.extractor.add_event(event, is_past=is_past))
        elif others:
            needed = ' and '.join(f'{hz:g}' for hz in others)
            self._refused = (
                *self._refused,
                f'the models or rate_hz need {needed} Hz, but the sensor delivers {sensor_hz:g} '
                f'Hz: let it publish at {needed} Hz, or train on your own recordings',
            )
            logger.warning(self._refused[-1])
        if self._follows_sensor:
            self._announce()

    def _announce(self) -> None:
        """Publish the specification of each kind of window."""
        announced = FeatureSpecifications(
            self.extractor.specifications,
            dataclasses.asdict(self.extractor.config),
            self._node.get_clock().now().nanoseconds,
        )
        self._specifications.publish(specifications_to_msg(announced))

    def _on_event(self, event: TrialEvent, published_ns: int) -> None:
        """Process an event. When the node starts, latched events of earlier trials come first."""
        if event.stamp_ns == 0:
            raise MessageError(
                f'the event {event.phase} of trial {event.trial_id} has no stamp: set '
                'header.stamp = node.get_clock().now().to_msg() when the phase begins, or publish '
                'it with `tactile event`, or with `ros2 topic pub` and "header: auto"'
            )
        is_first = time.monotonic() - self._begun_s < HISTORY_S
        is_past = is_first and published_ns < self._begun_ns
        if self._early_events is not None:
            self._early_events.append((event, is_past))
        self._publish(self.extractor.add_event(event, is_past=is_past))
        self._choose_period()

    def _watch(self) -> None:
        with self._node.lock:
            if self._node.stage is self and self._timeout.is_over():
                self._publish(self.extractor.time_out())

    def _publish(self, windows: Iterable[FeatureWindow]) -> None:
        for window in windows:
            if window.outcome != WindowOutcome.OK:
                self._node.get_logger().warning(
                    plain_text(f'no features of trial {window.trial_id}: {window.reason}')
                )
            self._features.publish(window)
            if self._node.is_active:
                self._emit(window)

    def _assess(self) -> Health:
        blocks = self.extractor.block_count
        is_fed, self._assessed_blocks = blocks > self._assessed_blocks, blocks
        windows = self.extractor.window_counts
        sentence = 'receiving samples' if is_fed else f'no samples on {STRAIN_TOPIC}'
        return Health(
            WARN if self._refused or not is_fed else OK,
            '; '.join([sentence, *self._refused]),
            {
                'blocks': blocks,
                'events': self.extractor.event_count,
                'samples dropped (late or repeated)': self.extractor.late_sample_count,
                'restarts of the samples': self.extractor.restart_count,
                'windows': sum(windows.values()),
                'windows without features': sum(windows.values()) - windows[WindowOutcome.OK],
                'specifications': len(self.extractor.specifications),
                'refused model files': len(self._refused),
                'active': self._node.is_active,
            },
        )


class TactileFeaturesNode(StageNode):
    """Node that publishes ``~/features`` for the trials on the strain and event topics.

    Phases that are detected in the tension are published on ``~/detected_events``. The
    specification of each kind of window is latched on ``~/specifications``. If the parameter
    ``models`` is set, the model files determine the features: full windows, early windows of
    several lengths, or both.

    If the samples of a window do not arrive, the window is refused after ``samples_timeout_s``,
    even if no other data arrive.

    Attributes
    ----------
    emit : callable
        Called with each window while the node is active. Set it before the node is configured.
    """

    poll_s = TRIAL_POLL_S  # short compared with windows of seconds; fewer wake-ups save CPU time

    def __init__(self, node_name: str = 'tactile_features', **node_options: Any) -> None:
        self.emit: Callable[[FeatureWindow], object] = ignore
        super().__init__(node_name, FeaturesNodeConfig, **node_options)

    def make_stage(self, config: FeaturesNodeConfig) -> FeaturesStage:
        return FeaturesStage(self, config, self.emit)

    @property
    def extractor(self) -> TrialFeatureExtractor | None:
        """The extractor, or None while the node is not configured."""
        stage: FeaturesStage | None = self.stage
        return stage.extractor if stage is not None else None

    @property
    def add_block(self) -> Callable[[StrainRecord], None]:
        """Function that accepts blocks of a sensor in the same process."""
        return self.input(STRAIN_TOPIC, lambda stage, block: stage.add_block(check_record(block)))
