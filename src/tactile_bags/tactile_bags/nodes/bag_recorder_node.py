# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Node that records the topics of one or more fingers to an MCAP bag, in serialised form."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
import json
from pathlib import Path
import time
from typing import Any, NamedTuple

from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header

from tactile_bags.audit import Audit, AuditSummary, FingerAuditor
from tactile_bags.bag_writer import BagWriter
from tactile_bags.errors import BagError
from tactile_bags.recorded_setup import WRITTEN_IN
from tactile_features.conversions import (
    event_from_msg,
    specifications_from_msg,
    strain_block_from_msg,
)
from tactile_features.spec import shared_rate_hz
from tactile_features.types import PHASE_ABORTED, PHASE_DONE
from tactile_msgs.msg import RecordingAudit, TrialEvent
from tactile_ros.bag_configs import RecorderConfig
from tactile_ros.health import Diagnostics, ERROR, Health, OK, WARN
from tactile_ros.message_classes import message_class
from tactile_ros.node_group import run_node
from tactile_ros.periodic import Periodic, Ticker
from tactile_ros.polling import PolledSubscription, PollingNode
from tactile_ros.qos import EVENTS, STREAM
from tactile_ros.strain import StrainStatus
from tactile_ros.topics import (
    AUDIT,
    EVENT,
    EVENT_TOPIC,
    FEATURES_TOPIC,
    FINGER_TOPICS,
    RecordedTopic,
    SPECIFICATIONS_TOPIC,
    STRAIN_TOPIC,
)

SAVE_PERIOD_S = 0.5
"""Period of flushes to the file and of syncs to the disk [s].

If the recorder is killed, at most the data of one period are lost. If the power fails, data that
are not on the disk yet are also lost.
"""

POLL_S = 0.02
"""Period at which topics are polled [s]. It does not affect arrival times: these are stamped by
the middleware."""

MOST_DISORDER_NS = 1_000_000_000
"""If an arrival time is earlier than the previous one by more than this, the clock was set back
[ns]."""

HISTORY_S = 0.5
"""If no latched event from before an activation arrives for this time [s], all have arrived."""

KEPT_LATCHED = 64
"""Number of recorded messages of each latched topic that are stored, to recognise messages that
are delivered again. Publishers keep up to 16."""

MAX_AUDITS = 500
"""Number of audits that the node keeps in memory. The summary in the bag counts all audits."""


class BagRecorderNode(PollingNode):
    """Node that records while it is active. When it is cleaned up, it closes the bag.

    Messages are written in their serialised form, so a replay sends identical bytes. Each trial is
    audited after its end.

    After an activation, latched topics first deliver their last messages. If the bag already
    contains a message, the message is skipped. Events of trials that ended before the activation
    are also skipped, because the bag has no samples of these trials. If a trial has begun but not
    ended, its events are recorded.

    If writing fails, for example because the disk is full, the recording ends and this node
    reports a failure. ``failure`` then contains the reason and the number of saved messages;
    otherwise it is None. Other nodes continue, because they may control motion.

    ``message_count`` is the number of messages that were written, and ``window_count`` the number
    of feature windows among them. ``audits`` contains the last `MAX_AUDITS` audits of trials.
    """

    poll_s = POLL_S

    def __init__(self, node_name: str = 'bag_recorder', **node_options: Any) -> None:
        super().__init__(node_name, RecorderConfig, **node_options)
        self._writer: BagWriter | None = None
        self._topics: dict[str, RecordedTopic] = {}
        self._auditors: dict[str, FingerAuditor] = {}
        self._recording: dict[str, PolledSubscription] = {}
        self._ahead: list[_Arrival] = []  # messages that wait for the next poll
        self._received_ns: dict[str, int] = {}  # arrival of the newest message of each topic
        self._savers: list[Periodic] = []
        self._save_error: BagError | None = None
        self._held: dict[str, list[bytes]] = {}  # events from before the activation, by topic
        self._held_ns = 0  # monotonic time at which the last of these events arrived
        self._latched: dict[str, deque[bytes]] = {}  # recorded messages of latched topics
        self._activated_ns = 0
        self._diagnostics: Diagnostics | None = None
        self._check: Periodic | None = None
        self._audit_publisher: Any = None
        self._audit_topic = ''
        self._started_ns = 0
        self._arrived_ns = self._set_back_ns = 0
        self._has_said_missing = False
        self._is_simulated = False  # whether a recorded sample or event was simulated
        self.message_count = 0
        self.window_count = 0
        self.audits: deque[Audit] = deque(maxlen=MAX_AUDITS)
        self._summary = AuditSummary()
        self.failure: str | None = None

    # -- lifecycle -----------------------------------------------------------------------

    def set_up(self, config: RecorderConfig) -> None:
        if not config.bag:
            raise ValueError('parameter bag is empty; set it to the folder of the new bag')
        self.failure = None
        self._arrived_ns = self._set_back_ns = 0
        self.is_finished = self.has_failed = False
        self.audits.clear()
        self._summary = AuditSummary()
        self._is_simulated = False
        metadata = json.loads(config.metadata)
        if not isinstance(metadata, dict):
            raise ValueError('parameter metadata is not a JSON object; write {"name": value}')
        metadata[WRITTEN_IN] = str(Path(config.bag).resolve())
        writer = self._writer = BagWriter(Path(config.bag), metadata)
        for namespace in config.namespaces:
            for topic in FINGER_TOPICS:
                self._topics[writer.add_topic(topic, namespace)] = topic
            self._auditors[namespace.strip('/')] = FingerAuditor(namespace.strip('/'))
        self._audit_topic = writer.add_topic(
            RecordedTopic(f'{self.get_name()}/audit', AUDIT, latched=True), self.get_namespace()
        )
        self._audit_publisher = self.create_publisher(RecordingAudit, '~/audit', EVENTS)
        self._diagnostics = Diagnostics(self, lambda: str(writer.path), self._health)
        self._held, self._latched = {}, {}
        # The bag is also checked periodically, because the disk can fail while no messages arrive.
        self._check = self.call_every(SAVE_PERIOD_S, self._check_bag)
        self._save_error = None
        for save in (writer.save, writer.sync):
            # Each function has a separate thread, because a slow sync to the disk must not delay
            # writing to the file.
            ticker = Ticker('bag saver')
            self._savers.append(ticker.every(SAVE_PERIOD_S, partial(self._save_part, save)))

    def start(self) -> None:
        if self._writer is None:
            raise ValueError(f'the recording has failed; clean up first: {self.failure}')
        self._activated_ns = time.time_ns()
        # Topics are subscribed last, because latched messages must not arrive before they can be
        # written.
        with self.lock:
            self._recording = {
                name: self.poll(
                    message_class(topic.type_name),
                    name,
                    lambda *_: None,  # `poll_now` takes messages of all topics in order
                    EVENTS if topic.latched else STREAM,
                    raw=True,
                )
                for name, topic in self._topics.items()
            }
        self._started_ns = time.monotonic_ns()
        self._has_said_missing = False

    def poll_now(self) -> None:
        self._take_all(time.time_ns())

    def _take_all(self, until_ns: int | None = None) -> None:
        """Take the messages of all topics, and record the messages until ``until_ns`` in order.

        Topics are polled one after the other. While the last topic is polled, messages may arrive
        on the first topic. Messages that arrived after ``until_ns`` are therefore stored until the
        next poll, after which no older message of another topic can follow.
        """
        with self.lock:
            arrivals = [*self._ahead]
            for name, subscription in self._recording.items():
                for data, info in subscription.waiting():
                    now_ns = time.time_ns()  # if the middleware provides no arrival time
                    received_ns = info.get('received_timestamp') or now_ns
                    arrival = _Arrival(name, data, received_ns, info['source_timestamp'] or now_ns)
                    arrivals.append(self._in_order(arrival))
            arrivals.sort(key=lambda arrival: arrival.received_ns)
            ready = [a for a in arrivals if until_ns is None or a.received_ns <= until_ns]
            self._ahead = arrivals[len(ready) :]
            for arrival in ready:
                self._record(arrival)

    def _in_order(self, arrival: _Arrival) -> _Arrival:
        """Return the arrival; if its time is before the last time on its topic, use the last time.

        The middleware delivers the messages of a topic in the order in which they were sent, but
        their arrival times may be in another order, for example if a message was sent again.
        """
        before_ns = self._received_ns.get(arrival.topic, 0)
        if 0 < before_ns - arrival.received_ns < MOST_DISORDER_NS:
            arrival = arrival._replace(received_ns=before_ns)
        self._received_ns[arrival.topic] = arrival.received_ns
        return arrival

    def _record(self, arrival: _Arrival) -> None:
        name, topic = arrival.topic, self._topics[arrival.topic]
        if self.failure is not None:
            return
        # An event from before the activation is recorded only if its trial had not ended by then.
        # This depends on the following events.
        is_event = topic.type_name == EVENT
        if is_event and arrival.source_ns < self._activated_ns:
            self._held.setdefault(name, []).append(arrival.data)
            self._held_ns = time.monotonic_ns()
            return
        if topic.latched and not is_event and arrival.data in self._latched.get(name, ()):
            return  # it was already recorded during an earlier activation
        try:
            self._write_held(name)
            self._write(name, arrival.data, arrival.received_ns)
        except BagError as error:
            self._end_recording(error)

    def _write(self, name: str, data: bytes, received_ns: int | None = None) -> None:
        writer, topic = self._writer, self._topics[name]
        if writer is None:
            return
        writer.write_raw(name, self._arrival_ns(received_ns), data)
        self.message_count += 1
        self.window_count += topic == FEATURES_TOPIC
        if topic.latched:
            self._latched.setdefault(name, deque(maxlen=KEPT_LATCHED)).append(data)
        if topic in (STRAIN_TOPIC, EVENT_TOPIC, SPECIFICATIONS_TOPIC):
            finger = name[: -len(topic.name)].strip('/')
            self._audit(self._auditors[finger], topic, data, writer)

    def _write_held(self, name: str) -> None:
        """Write the events from before the activation whose trials have not ended."""
        known = self._latched.get(name, ())
        for data in _drop_ended(self._held.pop(name, []), known):
            if data not in known:
                self._write(name, data)

    def _arrival_ns(self, received_ns: int | None = None) -> int:
        """Return the ROS time of an arrival [ns].

        ``received_ns`` is the arrival time on the computer's clock [ns]; if omitted, the current
        time. The result never decreases, because readers sort by it. If the clock is set back, the
        times continue from the last one.
        """
        now_ns = self.get_clock().now().nanoseconds
        if received_ns is not None:
            now_ns -= time.time_ns() - received_ns
        back_ns = self._arrived_ns - (now_ns + self._set_back_ns)
        if back_ns > MOST_DISORDER_NS:
            self._set_back_ns += back_ns
        self._arrived_ns = max(self._arrived_ns, now_ns + self._set_back_ns)
        return self._arrived_ns

    def stop(self) -> None:
        with self.lock:
            self._take_all()
            self._stop_listening()
            self._write_all_held()

    def _stop_listening(self) -> None:
        recording, self._recording = self._recording, {}
        for subscription in recording.values():
            self.unpoll(subscription)

    def _write_all_held(self) -> None:
        try:
            for name in list(self._held):
                self._write_held(name)
        except BagError as error:
            self._end_recording(error)

    def tear_down(self) -> None:
        self.stop()
        with self.lock:
            self._stop_saving()
            if self._writer is not None:
                try:
                    self._finish(self._writer)
                except BagError as error:
                    self._end_recording(error)
                self._writer = None
            if self._check is not None:
                self._check.cancel()
                self._check = None
            if self._diagnostics is not None:
                self._diagnostics.close()
                self._diagnostics = None
            if self._audit_publisher is not None:
                self.destroy_publisher(self._audit_publisher)
                self._audit_publisher = None
            self._topics, self._auditors = {}, {}

    def _finish(self, writer: BagWriter) -> None:
        # If the configuration failed, there is no publisher and nothing to audit.
        if self._audit_publisher is not None:
            for auditor in self._auditors.values():
                for audit in auditor.finish():
                    self._publish(audit, writer)
            writer.add_metadata({'audit': self._summary.to_dict()})
        writer.close()

    def save(self) -> None:
        """Wait until all recorded messages are on the disk; raise `BagError` if writing fails."""
        writer = self._writer
        if writer is None:
            raise BagError(self.failure or 'nothing is being recorded')
        writer.save()
        writer.sync()

    # -- failure -------------------------------------------------------------------------

    def _end_recording(self, error: BagError) -> None:
        """End the recording because the bag cannot be written. Other nodes are not affected."""
        self._stop_listening()
        self._stop_saving()
        self._held = {}
        writer, self._writer = self._writer, None
        if writer is None:
            return
        with suppress(BagError):  # closing may also fail, for example on a full disk
            writer.close()
        state = 'closed' if writer.is_complete else 'not closed, as after killing a recorder'
        self.failure = (
            f'recording ended: {error}; {writer.saved_count} messages are saved, '
            f'and the bag is {state}'
        )
        self.has_failed = True
        self.get_logger().error(self.failure)
        if self._diagnostics is not None:
            self._diagnostics.publish()  # now, because the process of the node will exit
        self.is_finished = True

    def _check_bag(self) -> None:
        with self.lock:
            if self._held and time.monotonic_ns() - self._held_ns > HISTORY_S * 1e9:
                self._write_all_held()
            if self._save_error is not None:
                self._end_recording(self._save_error)

    def _save_part(self, save: Callable[[], None]) -> None:
        """Call a function of the writer; `_check_bag` handles its error."""
        try:
            save()
        except BagError as error:
            self._save_error = error

    def _stop_saving(self) -> None:
        while self._savers:
            self._savers.pop().cancel()

    # -- audits --------------------------------------------------------------------------

    def _audit(
        self, auditor: FingerAuditor, topic: RecordedTopic, data: bytes, writer: BagWriter
    ) -> None:
        try:
            message = deserialize_message(data, message_class(topic.type_name))
            if topic == SPECIFICATIONS_TOPIC:
                auditor.nominal_rate_hz = shared_rate_hz(specifications_from_msg(message).specs)
                return
            if topic == STRAIN_TOPIC:
                block = strain_block_from_msg(message)
                audits = auditor.add_block(block)
                is_simulated = bool(block.status & StrainStatus.SIMULATED)
            else:
                event = event_from_msg(message)
                audits = auditor.add_event(event)
                is_simulated = event.simulated
        except Exception as error:  # invalid messages are recorded, too
            reason = f'it is recorded, but cannot be audited: {error!r}'
            self.message_guard.refuse(topic.name, reason)
            return
        if is_simulated and not self._is_simulated:
            self._is_simulated = True
            writer.add_metadata({'simulated': True})
        for audit in audits:
            self._publish(audit, writer)

    def _publish(self, audit: Audit, writer: BagWriter) -> None:
        self.audits.append(audit)
        self._summary.add(audit)
        message = _audit_to_msg(audit, str(writer.path))
        writer.write_raw(self._audit_topic, self._arrival_ns(), serialize_message(message))
        self._audit_publisher.publish(message)
        if not audit.passed:
            self.get_logger().warning(audit.format())

    # -- readiness -----------------------------------------------------------------------

    def unmatched_topics(self) -> list[str]:
        """Return the topics without a QoS-compatible publisher.

        If there are no such topics, the recorder is ready. Optional topics are recorded when they
        appear, but the recorder does not wait for them.
        """
        return [
            name
            for name, topic in self._topics.items()
            if not topic.optional
            and (self.config.rig or not topic.of_rig)
            and (self.config.classifier or not topic.of_classifier)
            and not self._publisher_count(name)
        ]

    def _publisher_count(self, name: str) -> int:
        subscription = self._recording.get(name)
        # If the QoS of a publisher is incompatible, the graph contains it, but its messages do not
        # arrive.
        count = subscription.get_publisher_count() if subscription else self.count_publishers(name)
        return int(count)

    def _health(self) -> Health:
        values = {'messages': self.message_count, 'trials_audited': self._summary.trials}
        if self.failure is not None:
            return Health(ERROR, self.failure, values)
        if not self._recording:
            return Health(WARN, 'not recording: activate the node', values)
        missing = self.unmatched_topics()
        if not missing:
            failed = self._summary.last_failed
            if failed is not None:
                return Health(WARN, failed.format(), values)
            return Health(OK, 'recording', values)
        names = ', '.join(missing)
        if (time.monotonic_ns() - self._started_ns) * 1e-9 < self.config.match_timeout_s:
            return Health(WARN, f'waiting for a publisher of {names}', values)
        message = f'no publisher of {names}: its messages are not recorded; start its node'
        if not self._has_said_missing:
            self._has_said_missing = True
            self.get_logger().error(message)
        return Health(ERROR, message, values)


def _drop_ended(events: list[bytes], known: Iterable[bytes]) -> list[bytes]:
    """Remove the events of trials that have ended from serialised events.

    If ``known``, the events that were already recorded, contains an event of a trial, all events
    of this trial are kept.
    """
    trials: list[tuple[str, list[bytes]]] = []
    has_ended: list[bool] = []
    for data in events:
        try:
            event = deserialize_message(data, TrialEvent)
        except Exception:  # invalid messages are recorded, too
            event = TrialEvent()
        # After the end of a trial, another trial may have the same id.
        if not trials or has_ended[-1] or trials[-1][0] != event.trial_id:
            trials.append((event.trial_id, []))
            has_ended.append(False)
        trials[-1][1].append(data)
        has_ended[-1] = event.phase in (PHASE_DONE, PHASE_ABORTED)
    return [
        data
        for (_, of_trial), is_over in zip(trials, has_ended, strict=True)
        if not is_over or any(data in known for data in of_trial)
        for data in of_trial
    ]


def _audit_to_msg(audit: Audit, bag: str) -> RecordingAudit:
    """Convert an audit to a ``tactile_msgs/RecordingAudit`` message."""
    return RecordingAudit(
        header=Header(stamp=_time(audit.end_ns)),
        bag=bag,
        finger=audit.finger,
        trial_id=audit.trial_id,
        passed=audit.passed,
        findings=list(audit.findings),
        span_start=_time(audit.start_ns),
        sample_count=audit.sample_count,
        lost_count=min(audit.lost_count, 2**64 - 1),  # invalid blocks can have any numbers
        gap_count=audit.gap_count,
        duplicate_count=audit.duplicate_count,
        disordered_count=audit.disordered_count,
        rate_hz=audit.rate_hz,
        nominal_rate_hz=audit.nominal_rate_hz,
        largest_step_s=audit.largest_step_s,
    )


def _time(stamp_ns: int) -> Time:
    sec, nanosec = divmod(stamp_ns, 10**9)
    return Time(sec=max(-(2**31), min(sec, 2**31 - 1)), nanosec=nanosec)


class _Arrival(NamedTuple):
    """A message of one topic. Its times are on the computer's clock [ns]."""

    topic: str
    data: bytes
    received_ns: int
    source_ns: int


def main() -> int:
    """Run the node in its own process."""
    return run_node(BagRecorderNode)
