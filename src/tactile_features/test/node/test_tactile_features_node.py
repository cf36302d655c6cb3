# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node over DDS: published features equal those of the code without ROS."""

from functools import partial
import gc
import json
import weakref

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import numpy as np
import pytest
from rclpy.exceptions import InvalidParameterValueException
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy
from std_msgs.msg import Header

from tactile_features import (
    FeatureConfig,
    spec_for,
    TrialFeatureExtractor,
    WindowOutcome,
)
from tactile_features.conversions import (
    event_from_msg,
    feature_window_from_msg,
    specifications_from_msg,
    strain_block_from_msg,
)
from tactile_features.tactile_features_node import (
    IDLE_POLL_S,
    TactileFeaturesNode,
    TRIAL_POLL_S,
)
from tactile_msgs.msg import FeatureSpecifications, StrainBlock, TactileFeatures, TrialEvent
from tactile_ros.qos import EVENTS, LATEST, RESULTS, STREAM
from tactile_testing.waiting import read_stderr, wait_until

PERIOD_NS = 16_666_667
START_NS = 1_760_000_000_123_456_789
TENSION_N = np.random.default_rng(0).normal(5.0, 1.0, 1000)


def header(stamp_ns):
    return Header(stamp=Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9))


def block(sequence, count=1, period_ns=PERIOD_NS):
    return StrainBlock(
        header=header(START_NS + sequence * period_ns),
        sequence=sequence,
        period_ns=period_ns,
        tension_n=TENSION_N[sequence : sequence + count].tolist(),
    )


def event(time_s, phase, trial_id='t1'):
    return TrialEvent(
        header=header(START_NS + round(time_s * 1e9)),
        trial_id=trial_id,
        protocol='texture',
        contact='flexion',
        phase=phase,
        simulated=True,
    )


FULL = spec_for('texture', FeatureConfig())
SHORT = spec_for('texture', FeatureConfig(texture_samples=90))
TRIAL = [event(1.0, 'approach'), event(2.0, 'glide'), event(7.0, 'hold'), event(11.0, 'done')]


class Bench:
    """The tested node, and a node that replaces sensor, trial runner and subscribers."""

    def __init__(self, context, **parameters):
        self.peer = Node('peer', context=context, namespace='finger')
        self.strain = self.peer.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
        self.events = self.peer.create_publisher(TrialEvent, 'trial_runner/events', EVENTS)
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        self.node = TactileFeaturesNode(
            context=context, namespace='finger', parameter_overrides=overrides
        )
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.peer)
        self.executor.add_node(self.node)
        self.subscriptions = []
        self.windows = self.hear(TactileFeatures, '~/features', feature_window_from_msg)

    def hear(self, kind, topic, convert=lambda msg: msg, qos=RESULTS):
        """Subscribe to a topic of the node; return a list to which its messages are appended."""
        heard = []
        topic = self.node.resolve_topic_name(topic)
        self.subscriptions.append(
            self.peer.create_subscription(kind, topic, lambda msg: heard.append(convert(msg)), qos)
        )
        return heard

    def spin_until(self, condition):
        wait_until(condition, step=partial(self.executor.spin_once, timeout_sec=0.05))

    def bring_up(self):
        assert self.node.bring_up()
        self.wait_for_match()

    def wait_for_match(self):
        """Wait until publishers and subscribers of each topic have discovered each other."""
        topics = [subscription.topic_name for subscription in self.subscriptions]
        self.spin_until(
            lambda: (
                self.strain.get_subscription_count() == 1
                and self.events.get_subscription_count() == 1
                and all(self.peer.count_publishers(topic) for topic in topics)
                and all(self.node.count_subscribers(topic) for topic in topics)
            )
        )

    def send_blocks(self, first, count):
        seen = self.node.extractor.block_count
        for sequence in range(first, first + count):
            self.strain.publish(block(sequence))
        self.spin_until(lambda: self.node.extractor.block_count == seen + count)

    def close(self):
        self.node.take_down()
        self.executor.shutdown()
        self.peer.destroy_node()


@pytest.fixture
def uncollected():
    """Disable garbage collection, so that only unreferenced objects are deleted."""
    gc.disable()
    yield
    gc.enable()


@pytest.fixture
def make_bench(context):
    benches = []

    def make(**parameters):
        benches.append(Bench(context, **parameters))
        return benches[-1]

    yield make
    for bench in benches:
        bench.close()


@pytest.mark.usefixtures('capfd')
def test_samples_that_do_not_come_are_told_in_time(make_bench):
    """After the release, neither samples nor events arrive."""
    bench = make_bench(samples_timeout_s=0.5)
    bench.bring_up()
    bench.send_blocks(0, 400)
    for msg in (event(2.0, 'hold', '\x1b[2Jt1'), event(11.0, 'release', '\x1b[2Jt1')):
        bench.events.publish(msg)
    bench.spin_until(lambda: bench.windows)
    wait_until(lambda: 'no features of trial ?[2Jt1: ' in read_stderr())
    (window,) = bench.windows
    assert window.outcome == WindowOutcome.GAP
    assert 'within 0.5 s after' in window.reason
    # When the sensor sends again, this trial gets no further window; the next trial is complete.
    bench.send_blocks(700, 300)
    for msg in (event(12.0, 'hold', 't2'), event(16.0, 'done', 't2')):
        bench.events.publish(msg)
    bench.spin_until(lambda: len(bench.windows) == 2)
    assert [w.outcome for w in bench.windows] == [WindowOutcome.GAP, WindowOutcome.OK]


def compute_expected(**parameters):
    """Return the windows of `TRIAL` that are computed without ROS, with all samples first."""
    extractor = TrialFeatureExtractor(FeatureConfig(**parameters))
    windows = extractor.add_block(strain_block_from_msg(block(0, 1000)))
    for msg in TRIAL:
        windows += extractor.add_event(event_from_msg(msg))
    return windows


@pytest.mark.parametrize('early', [False, True])
def test_publishes_the_bits_of_the_core(make_bench, early):
    bench = make_bench(early_windows=early)
    bench.bring_up()
    for i, msg in enumerate(TRIAL):
        bench.send_blocks(200 * i, 200)
        bench.events.publish(msg)
    bench.spin_until(lambda: len(bench.windows) == 2)
    assert bench.windows == compute_expected(early_windows=early)
    assert [w.outcome for w in bench.windows] == [WindowOutcome.OK, WindowOutcome.OK]
    extractor = bench.node.extractor
    assert (extractor.block_count, extractor.event_count) == (800, 4)
    assert extractor.window_counts[WindowOutcome.OK] == 2


def test_publishes_the_phases_that_it_finds_itself(make_bench):
    bench = make_bench(phases='stiffness', detected_contact='abduction')
    found = bench.hear(TrialEvent, '~/detected_events', event_from_msg, EVENTS)
    bench.bring_up()
    time_s = np.arange(600) * PERIOD_NS / 1e9
    tension_n = 3.0 * np.clip(np.minimum((time_s - 1.0) / 0.5, (7.0 - time_s) / 0.5), 0.0, 1.0)
    tension_n *= 1.0 - 0.05 * time_s
    message = block(0)
    message.tension_n = tension_n.tolist()
    bench.strain.publish(message)
    bench.spin_until(lambda: len(found) == 4 and bench.windows)
    assert [e.phase for e in found] == ['contact', 'hold', 'release', 'done']
    assert all(e.detected and e.contact == 'abduction' for e in found)
    (window,) = bench.windows
    assert (window.outcome, window.trial_id) == (WindowOutcome.OK, found[0].trial_id)
    assert found[1].stamp_ns == pytest.approx(START_NS + 1.5e9, abs=4e7)


def test_listens_when_configured_speaks_when_active_and_leaves_at_cleanup(make_bench):
    bench = make_bench()
    assert bench.node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    bench.wait_for_match()
    for msg in (*TRIAL, event(13.0, 'hold', 't2'), event(17.0, 'done', 't2')):
        bench.events.publish(msg)
    bench.send_blocks(0, 500)
    bench.spin_until(lambda: bench.node.extractor.event_count == 6)
    assert bench.node.extractor.window_counts[WindowOutcome.OK] == 1
    assert bench.node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    bench.send_blocks(500, 200)
    bench.spin_until(lambda: bench.windows)
    # The glide had ended before the node became active, so its window is not published.
    assert bench.windows == compute_expected()[1:]
    # The node is deactivated during the second trial, and reports the missing samples.
    assert bench.node.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    bench.spin_until(lambda: len(bench.windows) == 2)
    assert (bench.windows[1].trial_id, bench.windows[1].outcome) == ('t2', WindowOutcome.GAP)
    assert bench.node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
    bench.spin_until(lambda: bench.strain.get_subscription_count() == 0)


def test_samples_are_let_go_at_cleanup_and_not_when_python_collects(make_bench, uncollected):
    bench = make_bench()
    bench.bring_up()
    bench.send_blocks(0, 10)
    before = weakref.ref(bench.node.extractor)
    bench.node.trigger_deactivate()
    bench.node.trigger_cleanup()
    bench.bring_up()
    assert bench.node.extractor.block_count == 0
    wait_until(lambda: before() is None)  # a thread may still be in a callback


def test_trials_that_ended_before_it_was_configured_are_not_refused(make_bench):
    """Their latched events arrive, but their windows may have been published before a restart."""
    bench = make_bench()
    for msg in TRIAL:
        bench.events.publish(msg)
    bench.events.publish(event(15.0, 'glide', 't2'))
    bench.bring_up()
    bench.spin_until(lambda: bench.node.extractor.event_count == 5)
    bench.spin_until(lambda: bench.node.poll_s == TRIAL_POLL_S)
    bench.send_blocks(900, 100)
    bench.events.publish(event(16.2, 'done', 't2'))
    bench.spin_until(lambda: bench.windows)
    assert [w.trial_id for w in bench.windows] == ['t2']
    bench.spin_until(lambda: bench.node.poll_s == IDLE_POLL_S)


def test_diagnostics_tell_whether_samples_come_in_on_a_topic_of_the_asked_quality(make_bench):
    topic = '/finger/tactile_features/features'
    bench = make_bench(**{f'qos_overrides.{topic}.publisher.reliability': 'best_effort'})
    heard = bench.hear(DiagnosticArray, '/diagnostics', lambda msg: msg.status[0], 10)
    assert bench.node.bring_up()
    (info,) = bench.node.get_publishers_info_by_topic(topic)
    assert info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    bench.spin_until(lambda: heard and bench.strain.get_subscription_count() == 1)
    assert heard[-1].level == DiagnosticStatus.WARN
    assert 'no samples' in heard[-1].message
    bench.strain.publish(block(0))
    bench.spin_until(lambda: heard[-1].level == DiagnosticStatus.OK)
    assert {v.key: v.value for v in heard[-1].values}['blocks'] == '1'
    bench.spin_until(lambda: heard[-1].level == DiagnosticStatus.WARN)


def test_parameters_that_cannot_work_are_refused(make_bench):
    with pytest.raises(InvalidParameterValueException):
        make_bench(rate_hz=0.0)
    bench = make_bench(buffer_s=2.0)
    assert not bench.node.bring_up()


def test_the_models_decide_and_an_inactive_node_says_so_to_who_comes_late(
    make_bench, make_model_file, tmp_path, capfd
):
    make_model_file(tmp_path / 'a.npz', FULL)
    make_model_file(tmp_path / 'b.npz', SHORT)
    make_model_file(tmp_path / 'c.npz', SHORT, 'abduction')
    broken = tmp_path / 'broken.npz'
    broken.write_bytes(b'hello')
    bench = make_bench(
        models=str(tmp_path), contact='flexion', texture_samples=240, samples_timeout_s=2.0
    )
    assert bench.node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    announced = bench.hear(
        FeatureSpecifications, '~/specifications', specifications_from_msg, LATEST
    )
    health = bench.hear(DiagnosticArray, '/diagnostics', lambda msg: msg.status[0], 10)
    bench.spin_until(lambda: announced and health)
    (announced,) = announced
    hold = spec_for('stiffness', FeatureConfig())
    assert announced.specs == (FULL, SHORT, hold)
    assert announced.stamp_ns > 0
    # A replay creates the same extractor from the announcement alone.
    config = FeatureConfig(**json.loads(json.dumps(announced.config)))
    assert config == FeatureConfig(texture_samples=240, samples_timeout_s=2.0)
    again = TrialFeatureExtractor(config, announced.specs)
    assert (again.config, again.specifications) == (bench.node.extractor.config, announced.specs)
    log = capfd.readouterr().err
    assert f'model {broken} is refused' in log
    assert 'parameters from the models: texture_samples 180 and 90 (not 240)' in log
    assert health[-1].level == DiagnosticStatus.WARN
    assert str(broken) in health[-1].message
    values = {pair.key: pair.value for pair in health[-1].values}
    assert (values['refused model files'], values['specifications']) == ('1', '3')


@pytest.mark.parametrize('is_late', [False, True], ids=['events after', 'events before'])
def test_without_models_the_features_have_the_rate_of_the_sensor(make_bench, is_late):
    """The sensor may start after the first events of a trial."""
    bench = make_bench()
    announced = bench.hear(
        FeatureSpecifications, '~/specifications', specifications_from_msg, LATEST
    )
    bench.bring_up()
    glide = [event(1.0, 'glide'), event(6.0, 'done')]
    if is_late:
        for msg in glide:
            bench.events.publish(msg)
        bench.spin_until(lambda: bench.node.extractor.event_count == 2)
    assert not announced
    bench.strain.publish(block(0, 800, period_ns=10_000_000))
    if not is_late:
        for msg in glide:
            bench.events.publish(msg)
    bench.spin_until(lambda: bench.windows and announced)
    (window,) = bench.windows
    assert window.outcome == WindowOutcome.OK
    (announced,) = announced
    assert [spec.rate_hz for spec in announced.specs] == [100.0, 100.0]
    texture = announced.specs[0]
    assert (window.specification_digest, texture.sample_count) == (texture.digest, 300)
    again = TrialFeatureExtractor(FeatureConfig(**announced.config))
    assert again.specifications == announced.specs


def test_models_of_another_rate_than_the_sensor_are_told_once(
    make_bench, make_model_file, tmp_path, capfd
):
    make_model_file(tmp_path / 'a.npz', FULL)
    bench = make_bench(models=str(tmp_path))
    health = bench.hear(DiagnosticArray, '/diagnostics', lambda msg: msg.status[0], 10)
    bench.bring_up()
    for first in (0, 100):
        bench.strain.publish(block(first, 100, period_ns=10_000_000))
    sentence = 'need 60 Hz, but the sensor delivers 100 Hz: let it publish at 60 Hz'
    bench.spin_until(lambda: health and sentence in health[-1].message)
    assert health[-1].level == DiagnosticStatus.WARN
    assert capfd.readouterr().err.count(sentence) == 1


def test_events_that_cannot_be_used_are_logged_with_what_to_write(make_bench, monkeypatch, capfd):
    """The events of a program that publishes with the default QoS, and omits the stamp."""
    monkeypatch.setattr('tactile_ros.polling.MISFITS_S', 0.05)
    bench = make_bench()
    bench.bring_up()
    bench.peer.create_publisher(TrialEvent, 'trial_runner/events', 10)
    unstamped = event(2.0, 'hold')
    unstamped.header.stamp = Time()
    bench.events.publish(unstamped)
    log = []

    def is_said(*words):
        log.append(capfd.readouterr().err)
        return all(word in ''.join(log) for word in words)

    bench.spin_until(lambda: is_said('/finger/trial_runner/events', 'transient_local'))
    bench.spin_until(lambda: is_said('hold', 't1', 'header.stamp', 'tactile event'))
    assert bench.node.extractor.event_count == 0
    # A stamped event is accepted afterwards.
    bench.events.publish(event(2.0, 'hold'))
    bench.spin_until(lambda: bench.node.extractor.event_count == 1)


def test_without_a_usable_model_it_is_not_configured_and_says_why(make_bench, tmp_path, capfd):
    assert not make_bench(models=str(tmp_path)).node.bring_up()
    assert f'there are no model files (*.npz) in {tmp_path}' in capfd.readouterr().err
