# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random sequences of everything that can happen to a tendon, its servo and its bus.

The real client runs in virtual time, without its thread. The tension is whatever a rule says,
however the tendon moves: safety must not rest on a plausible one. For a long run, set
TENDON_SEQUENCES to the number of sequences.
"""

from contextlib import contextmanager, suppress
import logging
import math
import os

from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import initialize, invariant, rule, RuleBasedStateMachine
import pytest
from virtual_servo import VirtualBus, VirtualTime

from linear_guide_driver import TendonActuatorClient, TendonActuatorConfig
from linear_guide_driver.dynamixel import registers, servo, servo_monitor, tendon_client
from linear_guide_driver.dynamixel.servo_monitor import ServoMonitor
from linear_guide_driver.errors import LinearGuideDriverError, MotionRefusedError
from linear_guide_driver.safety import Order, Pull, SLACK_M, TopicWatchdog, Zero
from linear_guide_driver.stop_latch import EmergencyInput, StopLatch
from linear_guide_driver.tension import STILL_NS
from tactile_ros.refusal import Refusal

SEQUENCES = int(os.environ.get('TENDON_SEQUENCES', '30'))
SPEED_M_S = 0.02
SILENT = logging.Logger('silent', logging.CRITICAL)
HEALED_S = 6.0
"""After an outage: the longest back-off, and the servo comes to rest."""

ON_THE_WAY_COUNTS = 6
"""0.1 mm: the servo moves on while its position is read and a goal is written."""

WRITING_NS = 20_000_000
"""Longest time from a goal's admission until it is written: some transactions."""

SETTLED_NS = 100_000_000
"""Some polls, after which a limit that is exceeded has been acted upon."""


class Activity:
    """Stands in for the watch of a node that its own lifecycle state is active."""

    was_heard = True

    def __init__(self):
        self.is_active = True

    def find_loss(self, now_ns):
        return None if self.is_active else Refusal('The node is not active', 'activate it')


class Tendon(RuleBasedStateMachine):
    """Polls the servo, and starts pulls as the client does."""

    @initialize(
        unguarded=st.booleans(),
        reads=st.sampled_from([0.0, 2.0]),
        reach_m=st.sampled_from([0.002, 0.02]),
        found=st.sampled_from(['off', 'kept', 'foreign']),
        place_mm=st.sampled_from([0, 1, 10]),
        has_emergency=st.booleans(),
    )
    def start(self, unguarded, reads, reach_m, found, place_mm, has_emergency=False):
        self.time = VirtualTime()
        self.bus = VirtualBus(self.time)
        self.config = TendonActuatorConfig(
            unguarded=unguarded,
            max_displacement_m=reach_m,
            homing_speed_m_s=0.02,
            watchdog_s=0.2,
        )
        self.patch = pytest.MonkeyPatch()
        for module in (servo, servo_monitor, tendon_client):
            self.patch.setattr(module, 'time', self.time)
            self.patch.setattr(module, '_logger', SILENT)
        self.patch.setattr(tendon_client, 'open_servo', self.open_servo)
        self.patch.setattr(ServoMonitor, 'start', lambda _: None)
        self.patch.setattr(ServoMonitor, 'wait_poll', lambda *_: self.poll())
        self.peers = [TopicWatchdog(name, 0.2) for name in ('runner', 'guide')]
        self.activity = Activity()
        self.latch = StopLatch()
        self.latch.emergency = EmergencyInput('emergency', 0.5) if has_emergency else None
        self.pull = None  # that began, and may wind in
        self.wrong_goal = None
        self.goal_m = 0.0
        self.are_all_there = self.is_busy = False
        self.tension_n, self.sampled_at_ns = 0.0, None
        self.tares, self.tare_changed_at_ns = 0, None
        self.heard_at_ns = {}
        self.lost_since_ns = self.above_since_ns = self.stopped_since_ns = None
        self.pause_until_ns = 0
        self.client = self.make_client()
        self.latch.join(lambda: self.client.supervise(), lambda: 0)
        if found != 'off':
            self.bus.put(64, 1, 1)
            self.bus.put(11, 1, registers.MODE_CURRENT_BASED_POSITION if found == 'kept' else 3)
            self.bus.put(98, 1, 255)
            self.bus.put(20, 4, -2048)
            self.bus.turn_to(2048 + 65 * place_mm)
        self.bus.on_goal = self.note_goal
        self.is_busy = True
        self.client.connect()
        self.is_busy = False
        self.sample(reads)

    def make_client(self):
        watches = [*self.peers, self.activity]
        return TendonActuatorClient(self.config, watches=watches, latch=self.latch)

    def open_servo(self, config):
        self.bus.open()
        return self.bus, servo.set_up_servo(self.bus, config)

    def teardown(self):
        if hasattr(self, 'patch'):
            self.patch.undo()

    @property
    def safety(self):
        return self.client.safety

    @property
    def monitor(self):
        return self.client._monitor

    @property
    def at_m(self):
        return registers.counts_to_m(self.bus.get(132), self.config.pulley_radius_m)

    @property
    def now_ns(self):
        return self.time.now_ns

    # -- the driver ----------------------------------------------------------------------

    def poll(self):
        """Let the time of one poll pass; return the state if it came."""
        self.time.sleep(self.monitor.period_s)
        if self.are_all_there:
            self.feed()
            for which in (0, 1):
                self.beat(which)
            self.hear_emergency(False)
        self.latch.check(self.now_ns)
        if self.now_ns < self.pause_until_ns and self.monitor.outage:
            self.note()
            return None
        before = self.monitor._polls
        self.pause_until_ns = self.now_ns + round(self.monitor.poll_once() * 1e9)
        if self.pull and (self.safety.ending or abs(self.at_m - self.goal_m) < 1e-5):
            self.safety.finish()
            self.pull = None
        self.note()
        return self.monitor.state if self.monitor._polls > before else None

    @contextmanager
    def blocking(self, pull=None):
        """Run a call of the client that polls until it has ended."""
        self.pull, self.is_busy = pull, True
        try:
            yield
        finally:
            self.pull, self.is_busy = None, False

    # -- what happens --------------------------------------------------------------------

    @rule(polls=st.integers(1, 25))
    def pass_time(self, polls):
        for _ in range(polls):
            self.poll()

    @rule(polls=st.integers(1, 160))
    def pass_time_with_everybody_there(self, polls):
        self.are_all_there = True
        for _ in range(polls):
            self.poll()
        self.are_all_there = False

    @rule(gap_s=st.sampled_from([0.1, 0.3, 1.0, 5.0]))
    def sleep_of_the_host(self, gap_s):
        self.time.sleep(gap_s)
        self.poll()

    def feed(self):
        """Let one sample arrive; one that is infinite is saturated."""
        self.sampled_at_ns = self.now_ns
        is_saturated = math.isinf(self.tension_n)
        sample_n = 12.0 if is_saturated else self.tension_n
        return self.safety.add_samples([sample_n], is_saturated, self.now_ns)

    @rule(tension_n=st.sampled_from([0.0, 0.1, 1.0, 2.9, 3.1, 10.0, 15.1, 25.0, -20.0, math.inf]))
    def sample(self, tension_n):
        self.tension_n = tension_n
        if self.feed():
            self.client.supervise()

    @rule()
    def change_the_tare(self):
        for _ in range(2):  # the first that a driver hears of is no change
            self.tares += 1
            self.safety.tension.note_tare(self.tares)
        self.tare_changed_at_ns = self.now_ns

    @rule(which=st.integers(0, 1))
    def beat(self, which):
        self.peers[which].beat(self.now_ns)
        self.heard_at_ns[which] = self.now_ns

    @rule(
        share=st.floats(0.0, 1.0),
        contact=st.sampled_from(['flexion', 'abduction']),
        stop_n=st.sampled_from([0.0, 2.0]),
        is_prepared=st.booleans(),
    )
    def ask(self, share, contact, stop_n, is_prepared):
        if self.pull:
            return
        if is_prepared:
            self.activity.is_active = True
            self.hear_emergency(False)
            self.latch.reset(self.now_ns)
            self.sample(0.0)
            self.pass_time_with_everybody_there(5)
        pull = Pull(share * self.config.max_displacement_m, contact, stop_n)
        self.begin(pull)

    @rule(direction=st.sampled_from([-1, 1]))
    def ask_for_a_part_of_homing(self, direction):
        if not self.pull:
            self.begin(Pull(self.at_m + direction * 0.005, 'abduction', is_homing=True))

    def begin(self, pull):
        self.pull = pull
        try:
            self.client._begin(pull, SPEED_M_S)
            self.goal_m = self.client._goal_m
        except MotionRefusedError:
            self.pull = None
            place_m = 0.0 if self.is_stopped else max(0.0, self.at_m)
            lets_out = not pull.is_homing and pull.displacement_m <= place_m
            assert not (lets_out and self.can_be_reached), 'letting out was refused'
        except LinearGuideDriverError as error:
            self.monitor.fail(str(error))
            self.safety.finish()
            self.pull = None

    @rule()
    def cancel(self):
        self.lost_since_ns = None  # a hold that ends a release begins the holding time anew
        with suppress(LinearGuideDriverError):
            self.client.hold_here()

    @rule(presses=st.integers(1, 6), gap_s=st.sampled_from([0.02, 0.35, 1.9]))
    def press_stop(self, presses, gap_s):
        for _ in range(presses):
            self.latch.stop('pressed')
            with suppress(LinearGuideDriverError):
                self.client.hold_here()
            end_ns = self.now_ns + round(gap_s * 1e9)
            while self.now_ns < end_ns:
                self.poll()

    @rule()
    def hear_of_a_stop(self):
        self.latch.stop('pressed elsewhere')

    @rule()
    def reset(self):
        self.latch.reset(self.now_ns)

    @rule(is_stop=st.booleans())
    def hear_emergency(self, is_stop):
        self.latch.hear_emergency(is_stop, self.now_ns)

    @rule()
    def deactivate(self):
        self.activity.is_active = False
        self.client.supervise()

    @rule()
    def activate(self):
        self.activity.is_active = True

    @rule()
    def release(self):
        is_well = self.can_be_reached and not self.bus.faulty
        try:
            self.client.request_release()
        except LinearGuideDriverError:
            assert not is_well, 'a release was refused'

    @rule()
    def pull_to_slack(self):
        if self.pull:
            return
        self.poll()
        is_well = self.can_be_reached and not self.bus.faulty and not self.monitor.outage
        with self.blocking():
            try:
                self.client.pull_to(0.0)
            except LinearGuideDriverError:
                assert not is_well, 'letting out failed'

    @rule()
    def home(self):
        if self.pull:
            return
        self.are_all_there = True
        self.latch.reset(self.now_ns)
        with self.blocking(Pull(0.0, is_homing=True)), suppress(LinearGuideDriverError):
            self.client.home(0.2)
            self.tare_changed_at_ns = None
        self.are_all_there = False

    @rule(is_orderly=st.booleans())
    def start_again(self, is_orderly):
        if self.pull or not self.bus.is_plugged:
            return
        with self.blocking():
            self.bus.faulty = 0
            if is_orderly:
                self.client.close()
            else:
                self.time.sleep(1.0)
                self.client = self.make_client()
                self.sampled_at_ns = None
            with suppress(LinearGuideDriverError):
                self.client.connect()
                return
        self.bus.put(70, 1, 0)
        self.client.connect()

    # -- faults --------------------------------------------------------------------------

    @rule(fault=st.sampled_from(['silent', 'mute', 'refused']), count=st.integers(1, 40))
    def disturb_the_bus(self, fault, count):
        self.bus.fault, self.bus.faulty = fault, count

    @rule()
    def unplug(self):
        self.bus.is_plugged = False

    @rule()
    def plug_in(self):
        self.bus.is_plugged = True

    @rule()
    def lose_power(self):
        self.bus.lose_power()

    @rule()
    def report_a_fault(self):
        if self.bus.table[64]:
            self.bus.put(70, 1, 0x01)

    @rule()
    def shut_down(self):
        self.bus.shut_down(0x20)

    @rule()
    def trip_the_watchdog(self):
        self.bus.put(98, 1, 255)

    @rule(counts=st.sampled_from([-2000, -300, -70, -5]))
    def slip(self, counts):
        """Let the load turn the shaft out, and the goal with it."""
        if not self.pull:
            self.bus.turn_to(self.bus.position + counts)
            self.bus.put(116, 4, self.bus.get(132))

    @rule()
    def heal(self):
        self.bus.is_plugged, self.bus.faulty = True, 0
        if self.bus.table[70] and not self.bus.table[64]:
            self.poll()
            return  # only a restart ends that
        end_ns = self.now_ns + round(HEALED_S * 1e9)
        while self.now_ns < end_ns:
            self.poll()
        assert not self.monitor.outage
        assert self.bus.table[64]
        assert self.bus.table[98] == 10

    # -- what must hold ------------------------------------------------------------------

    @property
    def is_stopped(self):
        return self.latch.state.is_stopped

    @property
    def can_be_reached(self):
        is_line_there = self.bus.is_plugged and self.bus.is_open
        return is_line_there and bool(self.bus.table[64]) and not self.monitor.is_lost

    def is_live(self, ago_ns=0):
        then_ns = self.now_ns - ago_ns
        return (
            self.sampled_at_ns is not None
            and then_ns - self.sampled_at_ns <= self.config.guard_timeout_s * 1e9
            and self.safety.live_tension_n(then_ns) is not None  # not from before a new zero
        )

    def are_peers_heard(self, ago_ns=0):
        then_ns = self.now_ns - ago_ns
        return len(self.heard_at_ns) == 2 and all(
            then_ns - at_ns <= 200_000_000 for at_ns in self.heard_at_ns.values()
        )

    def note_goal(self, goal, present):
        """Note what is wrong with a goal; the driver's poll outlives what is raised in it."""
        try:
            self.check_goal(goal, present)
        except AssertionError as error:
            self.wrong_goal = self.wrong_goal or error

    def check_goal(self, goal, present):
        """Check a goal that is about to be written: only what may wind in winds in."""
        if goal <= present + ON_THE_WAY_COUNTS:
            return
        pull = self.pull
        assert pull is not None, f'something winds in by {goal - present} counts without a pull'
        assert not pull.lets_out
        assert not self.monitor.fault
        assert pull.is_homing or self.safety.zero is Zero.KNOWN
        assert not self.is_stopped, 'something winds in although the rig is stopped'
        assert self.activity.is_active
        assert self.are_peers_heard(WRITING_NS)
        is_blind = self.config.unguarded and not (pull.stop_tension_n or pull.is_homing)
        assert self.is_live(WRITING_NS) or is_blind
        changed_ns = self.tare_changed_at_ns
        is_new = changed_ns is not None and self.now_ns - changed_ns < STILL_NS
        assert pull.is_homing or is_blind or not is_new, 'the tare is not confirmed'
        assert not (self.is_live() and abs(self.tension_n) > self.safety.limit_n)

    def note(self):
        """Note since when something is wrong that the driver can see."""
        is_seen = not (self.monitor.outage or self.bus.faulty) and self.can_be_reached
        is_blind = self.config.unguarded
        is_lost = not (self.are_peers_heard() and self.activity.is_active) or not (
            is_blind or (self.is_live() and self.safety.tension.find_loss(self.now_ns) is None)
        )
        lets_out = self.pull and self.pull.displacement_m <= self.at_m
        is_above = self.is_live() and abs(self.tension_n) > self.safety.limit_n
        if not (is_seen and is_lost and self.at_m > SLACK_M) or lets_out or self.is_busy:
            self.lost_since_ns = None
        elif self.lost_since_ns is None:
            self.lost_since_ns = self.now_ns
        # Unlike after a loss, no cancelled goal postpones it.
        to_slack = self.pull and self.pull.lets_out
        if not (is_seen and self.is_stopped and self.at_m > SLACK_M) or to_slack or self.is_busy:
            self.stopped_since_ns = None
        elif self.stopped_since_ns is None:
            self.stopped_since_ns = self.now_ns
        if not (is_seen and is_above):
            self.above_since_ns = None
        elif self.above_since_ns is None:
            self.above_since_ns = self.now_ns
        self.check_rest()

    def check_rest(self):
        """Above the limit, and after a loss, the tendon is let out."""
        safety = self.safety
        goal_m = registers.counts_to_m(self.bus.get(116), self.config.pulley_radius_m)
        if self.above_since_ns is not None and self.now_ns - self.above_since_ns > SETTLED_NS:
            assert safety.decide(self.at_m, self.now_ns) is Order.RELEASE
            assert goal_m <= max(safety.slack_m, -0.0) + 1e-5
        if safety.is_slack(self.at_m, self.now_ns):
            return
        for since_ns in (self.lost_since_ns, self.stopped_since_ns):
            held_s = 0.0 if since_ns is None else (self.now_ns - since_ns - SETTLED_NS) / 1e9
            if held_s > self.config.slack_after_s:
                assert safety.decide(self.at_m, self.now_ns) is Order.RELEASE
                if not self.monitor.outage:
                    assert goal_m <= max(safety.slack_m, -0.0) + 1e-5

    @invariant()
    def only_what_may_wind_in_winds_in(self):
        if hasattr(self, 'client') and self.wrong_goal:
            raise self.wrong_goal

    @invariant()
    def the_limit_is_guarded_at_once(self):
        if not hasattr(self, 'client') or not self.can_be_reached:
            return
        if self.monitor.outage or self.bus.faulty or not self.is_live():
            return
        if abs(self.tension_n) > self.safety.limit_n:
            with suppress(LinearGuideDriverError):
                self.client.supervise()
            if self.bus.table[98] != 255:
                assert self.bus.get(116) <= max(0, self.bus.get(132) + ON_THE_WAY_COUNTS)

    @invariant()
    def a_stopped_rig_pulls_nothing(self):
        if not hasattr(self, 'client') or not self.is_stopped or not self.can_be_reached:
            return
        if self.monitor.outage or self.bus.faulty or self.bus.table[98] == 255:
            return
        self.client.supervise()
        assert self.bus.get(116) <= max(0, self.bus.get(132) + ON_THE_WAY_COUNTS)


def test_a_pull_that_lets_out_winds_nothing_in_however_late_it_is_written():
    tendon = Tendon()
    tendon.start(unguarded=True, reads=0.0, reach_m=0.02, found='off', place_mm=0)
    try:
        tendon.sample(0.0)
        tendon.pass_time_with_everybody_there(5)
        tendon.begin(Pull(0.01))
        tendon.pass_time_with_everybody_there(60)
        assert tendon.at_m > 0.0099
        tendon.client.request_release()
        tendon.pass_time(1)
        write, goals = tendon.bus.write, []
        before_m = tendon.at_m
        assert 0.008 < before_m < 0.0095

        def write_late(register, value):
            if register == registers.PROFILE_VELOCITY:
                tendon.time.sleep(0.1)  # as when two packets are lost
            write(register, value)

        tendon.bus.write = write_late
        tendon.bus.on_goal = lambda goal, present: goals.append((goal, present))
        tendon.begin(Pull(0.008))
        (last,) = goals
        assert tendon.at_m < 0.006
        assert last[0] <= last[1] + ON_THE_WAY_COUNTS
    finally:
        tendon.teardown()


def test_a_pull_to_slack_goes_on_when_the_servo_reports_a_fault():
    tendon = Tendon()
    tendon.start(unguarded=False, reads=0.0, reach_m=0.02, found='off', place_mm=1)
    try:
        tendon.disturb_the_bus('refused', 1)
        tendon.report_a_fault()
        tendon.pull_to_slack()  # says when it fails
    finally:
        tendon.teardown()


TestTendon = pytest.mark.filterwarnings('ignore')(Tendon.TestCase)
Tendon.TestCase.settings = settings(
    max_examples=SEQUENCES,
    stateful_step_count=40,
    deadline=None,
    # A sequence takes too long to be shortened.
    phases=[Phase.explicit, Phase.reuse, Phase.generate],
)
