# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random sequences of commands and faults of a tendon, its servo and its bus.

The real client runs in virtual time, without its thread. The tension is chosen at random and does
not depend on the motion of the tendon, because the tests must also pass with implausible tensions.
For a long run, set TENDON_SEQUENCES to the number of sequences.
"""

from contextlib import contextmanager, suppress
import logging
import math
import os

from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import initialize, invariant, rule, RuleBasedStateMachine
import pytest
from samples import feed
from scripted_servo import find_fields
from virtual_servo import VirtualBus, VirtualLine, VirtualServo, VirtualTime

from linear_guide_driver import TendonActuatorClient, TendonActuatorConfig
from linear_guide_driver.dynamixel import bus, registers, servo, servo_monitor, tendon_client
from linear_guide_driver.dynamixel.servo_monitor import ServoMonitor
from linear_guide_driver.errors import (
    DeviceRefusedError,
    LinearGuideDriverError,
    MotionRefusedError,
)
from linear_guide_driver.safety import Order, Pull, State, TopicWatchdog, Zero
from linear_guide_driver.stop_latch import EmergencyInput, StopLatch
from linear_guide_driver.tension import STILL_NS
from tactile_ros.refusal import Refusal

SEQUENCES = int(os.environ.get('TENDON_SEQUENCES', '30'))
SPEED_M_S = 0.02
SILENT = logging.Logger('silent', logging.CRITICAL)
HEALED_S = 6.0
"""Time [s] after which an outage must be over and the servo at rest.

It includes the longest pause between two attempts to reconnect."""

ON_THE_WAY_COUNTS = 6
"""Distance that the servo moves between a read of its position and the next write [counts].

It is 0.1 mm of tendon."""

WRITING_NS = 20_000_000
"""Longest time [ns] from the admission of a goal until it is written: a few exchanges."""

SETTLED_NS = 100_000_000
"""Time [ns] of a few polls, after which the driver must have reacted to an exceeded limit."""

FAULTS = ('silent', 'mute', 'refused', 'late', 'doubled')
WRITE = 3
"""Code of the instruction that writes registers."""


class Activity:
    """Replaces the watch of a node's own lifecycle state."""

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
        found=st.sampled_from(['off', 'kept', 'unarmed', 'foreign']),
        place_mm=st.sampled_from([0, 1, 10]),
        first_count=st.sampled_from([2048, 3800]),
        has_emergency=st.booleans(),
    )
    def start(
        self,
        unguarded,
        reads,
        reach_m,
        found,
        place_mm,
        first_count=2048,
        has_emergency=False,
    ):
        self.time = VirtualTime()
        self.time.on_step = self.step
        self.own = self.servo = VirtualServo(self.time, first_count)
        self.line = VirtualLine(self.time, self.servo)
        self.config = TendonActuatorConfig(
            unguarded=unguarded,
            max_displacement_m=reach_m,
            homing_speed_m_s=0.02,
            watchdog_s=0.2,
        )
        self.patch = pytest.MonkeyPatch()
        for module in (bus, servo, servo_monitor, tendon_client):
            self.patch.setattr(module, 'time', self.time)
        for module in (servo, servo_monitor, tendon_client):
            self.patch.setattr(module, '_logger', SILENT)
        self.patch.setattr(servo, 'DynamixelBus', lambda *_: VirtualBus(self.line))
        self.patch.setattr(ServoMonitor, 'start', lambda _: None)
        self.patch.setattr(ServoMonitor, 'wait_poll', lambda *_: self.poll())
        self.peers = [TopicWatchdog(name, 0.2) for name in ('runner', 'guide')]
        self.activity = Activity()
        self.latch = StopLatch()
        self.latch.emergency = EmergencyInput('emergency', 0.5) if has_emergency else None
        self.pull = None  # running pull
        self.speed_m_s = 0.0  # speed of this pull [m/s]
        self.wrong = None
        self.goal_m = 0.0
        self.are_all_there = self.is_busy = False
        self.tension_n, self.sampled_at_ns = 0.0, None
        self.tares, self.tare_changed_at_ns = 0, None
        self.heard_at_ns = {}
        self.lost_since_ns = self.above_since_ns = self.stopped_since_ns = None
        self.strange_since_ns = None
        self.pause_until_ns = 0
        self.slipped_counts = 0  # distance slipped since the last poll
        self.client = self.make_client()
        self.latch.join(lambda: self.client.supervise(), lambda: 0)
        self.zero_lost_counts = 0  # ``lost_counts`` of the servo when its zero was taken
        # True if the servo has restarted, and the driver has not set it up since.
        self.has_restarted = False
        self.line.on_heard = self.note_instruction
        if found != 'off':
            self.servo.leave_as_a_driver(first_count, first_count + 65 * place_mm)
        if found == 'unarmed':
            self.servo.put(98, 1, 0)
            self.servo.put(220, 4, registers.OUR_MARK)
        if found == 'foreign':
            self.servo.put(98, 1, 0)
            self.servo.put(11, 1, 3)
            with pytest.raises(DeviceRefusedError):
                self.connect()
            assert not self.servo.writes, 'a foreign servo was written to'
            self.servo.put(64, 1, 0)
        self.connect()
        self.sample(reads)

    def make_client(self):
        watches = [*self.peers, self.activity]
        return TendonActuatorClient(self.config, watches=watches, latch=self.latch)

    def connect(self):
        self.is_busy = True
        try:
            self.client.connect()
        finally:
            self.is_busy = False

    def step(self):
        """Let all servos turn, and record a violation if a shaft moves too fast."""
        before = self.servo.position
        for each in {self.own, self.servo}:
            each.turn()
        if self.servo.goal > before + ON_THE_WAY_COUNTS and self.servo.position > before:
            self.note_wrong(self.check_motion)

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
        return registers.counts_to_m(self.servo.get(132), self.config.pulley_radius_m)

    @property
    def now_ns(self):
        return self.time.now_ns

    # -- the driver ----------------------------------------------------------------------

    def poll(self):
        """Let the time of one poll pass; return the new state, or None if the poll failed."""
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
        was_fine = not self.line.faults
        self.pause_until_ns = self.now_ns + round(self.monitor.poll_once() * 1e9)
        if was_fine and self.monitor._polls > before:
            self.strange_since_ns, self.slipped_counts = None, 0
        if self.pull and (self.safety.ending or abs(self.at_m - self.goal_m) < 1e-5):
            self.safety.finish()
            self.pull = None
        self.note()
        return self.monitor.state if self.monitor._polls > before else None

    @contextmanager
    def blocking(self, pull=None):
        """Context manager for a blocking call of the client. The call itself polls the servo."""
        self.pull, self.is_busy = pull, True
        self.speed_m_s = self.config.homing_speed_m_s
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
        """Let one sample arrive. An infinite tension means a saturated sample."""
        self.sampled_at_ns = self.now_ns
        is_saturated = math.isinf(self.tension_n)
        sample_n = 12.0 if is_saturated else self.tension_n
        return feed(self.safety, [sample_n], self.now_ns, is_saturated=is_saturated)

    @rule(tension_n=st.sampled_from([0.0, 0.1, 1.0, 2.9, 3.1, 10.0, 15.1, 25.0, -20.0, math.inf]))
    def sample(self, tension_n):
        self.tension_n = tension_n
        if self.feed():
            self.client.supervise()

    @rule()
    def change_the_tare(self):
        for _ in range(2):  # for a new driver, the first tare is not a change
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
        speed_m_s=st.sampled_from([0.004, SPEED_M_S]),
    )
    def ask(self, share, contact, stop_n, is_prepared, speed_m_s):
        if self.pull:
            return
        if is_prepared:
            self.activity.is_active = True
            self.hear_emergency(False)
            self.latch.reset(self.now_ns)
            self.sample(0.0)
            self.pass_time_with_everybody_there(5)
        pull = Pull(share * self.config.max_displacement_m, contact, stop_n)
        self.begin(pull, speed_m_s)

    @rule(direction=st.sampled_from([-1, 1]))
    def ask_for_a_part_of_homing(self, direction):
        if not self.pull:
            self.begin(Pull(self.at_m + direction * 0.005, 'abduction', is_homing=True))

    def begin(self, pull, speed_m_s=SPEED_M_S):
        before_m_s = self.speed_m_s  # speed of a goal that may still be active
        self.pull, self.speed_m_s = pull, speed_m_s
        is_latched = self.latch.find_loss(self.now_ns) is not None
        try:
            self.client._begin(pull, speed_m_s)
            self.goal_m = self.client._goal_m
            self.lost_since_ns = None  # a new pull restarts slack_after_s
        except MotionRefusedError:
            self.pull, self.speed_m_s = None, before_m_s
            # While the rig is stopped, or the emergency stop was not heard, only a pull to a
            # displacement of 0 must be admitted. Otherwise, every pull that does not tighten must.
            place_m = 0.0 if is_latched else max(0.0, self.at_m)
            slackens = not pull.is_homing and pull.displacement_m <= place_m
            assert not (slackens and self.can_be_reached), 'slackening was refused'
        except LinearGuideDriverError as error:
            self.monitor.fail(str(error))
            self.safety.finish()
            self.pull = None

    @rule()
    def cancel(self):
        self.lost_since_ns = None  # a cancelled goal restarts slack_after_s
        pull = self.pull if self.safety.ending is None else None
        slackens = self.safety.state is State.RELEASING or (pull and pull.slackens)
        with suppress(LinearGuideDriverError):
            self.client.hold_here()
        is_slack = self.safety.is_slack(self.at_m, self.now_ns)
        if slackens and not is_slack and (self.is_stopped or self.is_lost):
            order = self.safety.decide(self.at_m, self.now_ns)
            assert order is Order.RELEASE, 'a cancelled goal has ended slackening'

    @rule(
        missing=st.sampled_from(['nothing', 'samples', 'peers', 'reset']), polls=st.integers(1, 8)
    )
    def cancel_while_it_slackens(self, missing, polls):
        self.ask(1.0, 'flexion', 0.0, True, SPEED_M_S)
        self.pass_time_with_everybody_there(60)
        if missing == 'reset':
            self.latch.stop('pressed')
        with suppress(LinearGuideDriverError):
            self.client.request_release()
        if missing in ('samples', 'peers'):
            self.time.sleep(self.config.guard_timeout_s)
        for _ in range(polls):
            if missing == 'samples':
                self.beat(0)
                self.beat(1)
            self.poll()
        self.cancel()

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
        is_well = self.can_be_reached and not self.line.faults
        try:
            self.client.request_release()
        except LinearGuideDriverError:
            assert not is_well, 'a release was refused'

    @rule()
    def pull_to_slack(self):
        if self.pull:
            return
        self.poll()
        is_well = self.can_be_reached and not self.line.faults and not self.monitor.outage
        with self.blocking():
            try:
                self.client.pull_to(0.0)
            except LinearGuideDriverError:
                assert not is_well, 'slackening failed'

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
        if self.pull or not self.line.is_plugged or self.servo is not self.own:
            return
        with self.blocking():
            self.line.faults.clear()
            if is_orderly:
                self.client.close()
            else:
                self.time.sleep(1.0)
                self.client = self.make_client()
                self.sampled_at_ns = None
            with suppress(LinearGuideDriverError):
                self.client.connect()
                return
        self.servo.put(70, 1, 0)
        self.servo.put(64, 1, 0)  # a new driver may have refused a servo with its torque on
        self.connect()

    # -- faults --------------------------------------------------------------------------

    @rule(fault=st.sampled_from(FAULTS), count=st.integers(1, 40))
    def disturb_the_bus(self, fault, count):
        self.set_faults([fault] * count)

    @rule(faults=st.lists(st.sampled_from([*FAULTS, 'fine']), min_size=1, max_size=20))
    def disturb_some_exchanges(self, faults):
        self.set_faults(faults)

    @rule(skip=st.integers(0, 6), count=st.integers(1, 3))
    def lose_writes_that_seem_to_be_acknowledged(self, skip, count):
        self.set_faults(['fine'] * skip + ['late', 'silent'] * count)

    def set_faults(self, faults):
        self.line.faults.clear()
        self.line.faults.extend(faults)

    @rule()
    def unplug(self):
        self.line.unplug()

    @rule()
    def plug_in(self):
        self.line.plug_in()

    @rule(is_torque_on=st.booleans())
    def lose_power(self, is_torque_on):
        self.servo.lose_power(is_torque_on=is_torque_on)
        self.has_restarted = self.has_restarted or self.servo is self.own

    @rule(
        is_torque_on=st.booleans(),
        watchdog=st.sampled_from([0, 10, 255]),
        away_mm=st.sampled_from([0, 3, 300]),
    )
    def exchange(self, is_torque_on, watchdog, away_mm):
        """Exchange the servo for another one, which another driver has set up."""
        self.line.unplug()
        other = VirtualServo(self.time, 1000)
        other.leave_as_a_driver(900, 900 + 65 * away_mm)
        other.put(64, 1, int(is_torque_on))
        other.put(98, 1, watchdog)
        self.servo = self.line.servo = other
        self.line.plug_in()

    @rule(current=st.sampled_from([1193, 50]), velocity=st.sampled_from([0, 200, 3]))
    def change_registers(self, current, velocity):
        """Change registers that the driver has written."""
        if self.servo.table[64] and self.servo.table[98] not in (0, 255):
            self.servo.put(102, 2, current)
            self.servo.put(112, 4, velocity)
            self.strange_since_ns = self.now_ns

    @rule()
    def report_a_fault(self):
        if self.servo.table[64]:
            self.servo.put(70, 1, 0x01)

    @rule()
    def shut_down(self):
        self.servo.shut_down(0x20)

    @rule()
    def trip_the_watchdog(self):
        self.servo.put(98, 1, 255)

    @rule(counts=st.sampled_from([-2000, -300, -70, -5]))
    def slip(self, counts):
        """Let the load turn the shaft and its goal in the direction that slackens the tendon."""
        # The driver would take a larger slip between two polls for an impossible jump.
        if not self.pull and self.slipped_counts + counts >= -2000:
            self.slipped_counts += counts
            self.servo.turn_to(self.servo.position + counts)
            self.servo.put(116, 4, self.servo.get(132))

    @rule()
    def heal(self):
        self.line.unplug()
        self.line.plug_in()
        self.servo = self.line.servo = self.own
        self.line.faults.clear()
        if self.servo.table[70] and not self.servo.table[64]:
            self.poll()
            return  # only a restart of the servo ends its hardware error
        end_ns = self.now_ns + round(HEALED_S * 1e9)
        while self.now_ns < end_ns:
            self.poll()
        assert not self.monitor.outage
        assert self.servo.table[64]
        assert self.servo.table[98] == 10
        assert self.servo.get(102, 2) == self.client._servo.desired.current

    # -- what must hold ------------------------------------------------------------------

    @property
    def is_stopped(self):
        return self.latch.state.is_stopped

    @property
    def can_be_reached(self):
        bus = self.client._servo.bus
        # A port that was open when the cable was unplugged stays lost.
        is_line_there = self.line.is_plugged and bus._is_open
        is_line_there = is_line_there and bus._port.opened == self.line.plugs
        if self.has_restarted or self.servo is not self.own:
            return False
        return is_line_there and bool(self.servo.table[64]) and not self.monitor.is_lost

    def is_live(self, ago_ns=0):
        then_ns = self.now_ns - ago_ns
        return (
            self.sampled_at_ns is not None
            and then_ns - self.sampled_at_ns <= self.config.guard_timeout_s * 1e9
            # The driver discards readings that are older than a new zero.
            and self.safety.tension.live_n(then_ns) is not None
        )

    def are_peers_heard(self, ago_ns=0):
        then_ns = self.now_ns - ago_ns
        return len(self.heard_at_ns) == 2 and all(
            then_ns - at_ns <= 200_000_000 for at_ns in self.heard_at_ns.values()
        )

    @property
    def is_lost(self):
        """True if a node or topic that a taut tendon needs is lost."""
        is_there = self.are_peers_heard() and self.activity.is_active
        return not is_there or not (self.config.unguarded or self.is_live())

    def note_wrong(self, check, *arguments):
        """Call ``check`` and record a failed assertion, which the driver's poll would only log."""
        try:
            check(*arguments)
        except AssertionError as error:
            self.wrong = self.wrong or error

    def note_instruction(self, instruction, parameters):
        """Check an instruction that the servo receives."""
        if instruction != WRITE:
            return
        address, data = parameters[0], parameters[2:]
        written = {
            field: int.from_bytes(data[field - address :][:size], 'little', signed=True)
            for field, size in find_fields(address, len(data))
        }
        self.note_wrong(self.check_write, written)
        if written.get(98) == 0:  # an old goal is active again until the next poll
            self.strange_since_ns = self.now_ns
        if written.get(64) or 20 in written:
            self.zero_lost_counts = self.servo.lost_counts
            self.has_restarted = False
        if 116 in written and self.servo.table[64] and self.servo.table[98] != 255:
            goal, present = written[116], self.servo.get(132)
            velocity = written.get(112, self.servo.get(112))
            self.note_wrong(self.check_goal, goal, present, velocity)

    def check_write(self, written):
        assert self.servo is self.own, f'another servo is written to: {written}'

    def check_goal(self, goal, present, velocity):
        """Check that a written goal tightens only if the running pull may tighten."""
        if goal <= present + ON_THE_WAY_COUNTS:
            return
        pull = self.pull
        assert pull is not None, f'something tightens by {goal - present} counts without a pull'
        assert not pull.slackens
        assert not self.monitor.fault
        assert pull.is_homing or self.safety.zero is Zero.KNOWN
        assert not self.is_stopped, 'something tightens although the rig is stopped'
        assert self.activity.is_active
        assert pull.is_homing or self.servo.lost_counts == self.zero_lost_counts, 'a wrong zero'
        assert self.are_peers_heard(WRITING_NS)
        is_blind = self.config.unguarded and not (pull.stop_tension_n or pull.is_homing)
        assert self.is_live(WRITING_NS) or is_blind
        changed_ns = self.tare_changed_at_ns
        is_new = changed_ns is not None and self.now_ns - changed_ns < STILL_NS
        assert pull.is_homing or is_blind or not is_new, 'the tare is not confirmed'
        assert not (self.is_live() and abs(self.tension_n) > self.safety.limit_n)
        self.check_speed(velocity)

    def check_motion(self):
        """Check the speed of a shaft that tightens, unless the test has changed its registers."""
        if self.servo is self.own and self.strange_since_ns is None:
            self.check_speed(self.servo.get(112))

    def check_speed(self, velocity):
        highest = registers.m_s_to_velocity(self.speed_m_s, self.config.pulley_radius_m)
        limit_a = self.config.current_limit_a
        if self.pull is not None:
            limit_a = self.safety.find_current_limit_a(self.pull)
        limit = registers.a_to_current(limit_a)
        assert 0 < velocity <= highest, f'velocity {velocity} instead of {highest}'
        assert 0 < self.servo.get(102, 2) <= limit, f'current {self.servo.get(102, 2)}'

    def note(self):
        """Record when a problem began that the driver can detect; call `check_rest`."""
        is_seen = not (self.monitor.outage or self.line.faults) and self.can_be_reached
        # While the zero is unknown, an unconfirmed tare is not a problem.
        is_doubted = (
            self.safety.zero is not Zero.UNKNOWN
            and self.safety.tension.find_loss(self.now_ns) is not None
        )
        is_lost = self.is_lost or (is_doubted and not self.config.unguarded)
        slackens = self.pull and self.pull.displacement_m <= self.at_m
        is_above = self.is_live() and abs(self.tension_n) > self.safety.limit_n
        is_taut = not self.safety.is_slack(self.at_m, self.now_ns)
        if not (is_seen and is_lost and is_taut) or slackens or self.is_busy:
            self.lost_since_ns = None
        elif self.lost_since_ns is None:
            self.lost_since_ns = self.now_ns
        # A cancelled goal postpones slackening after a loss, but not after a stop.
        to_slack = self.pull and self.pull.slackens
        if not (is_seen and self.is_stopped and is_taut) or to_slack or self.is_busy:
            self.stopped_since_ns = None
        elif self.stopped_since_ns is None:
            self.stopped_since_ns = self.now_ns
        if not (is_seen and is_above):
            self.above_since_ns = None
        elif self.above_since_ns is None:
            self.above_since_ns = self.now_ns
        self.check_rest()

    def check_rest(self):
        """Check that the tendon is slackened: above the limit, after a loss and after a stop."""
        safety = self.safety
        goal_m = registers.counts_to_m(self.servo.get(116), self.config.pulley_radius_m)
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
    def only_what_may_tighten_tightens_and_as_it_was_asked(self):
        if hasattr(self, 'client') and self.wrong:
            raise self.wrong

    @invariant()
    def the_limit_is_guarded_at_once(self):
        if not hasattr(self, 'client') or not self.can_be_reached:
            return
        if self.monitor.outage or self.line.faults or not self.is_live():
            return
        if abs(self.tension_n) > self.safety.limit_n:
            with suppress(LinearGuideDriverError):
                self.client.supervise()
            if self.servo.table[98] != 255:
                assert self.servo.get(116) <= max(0, self.servo.get(132) + ON_THE_WAY_COUNTS)

    @invariant()
    def a_stopped_rig_pulls_nothing(self):
        if not hasattr(self, 'client') or not self.is_stopped or not self.can_be_reached:
            return
        if self.monitor.outage or self.line.faults or self.servo.table[98] == 255:
            return
        self.client.supervise()
        assert self.servo.get(116) <= max(0, self.servo.get(132) + ON_THE_WAY_COUNTS)


def test_a_pull_that_slackens_tightens_nothing_however_late_it_is_written():
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
        assert 0.008 < tendon.at_m < 0.0095
        goals = []
        tendon.check_goal = lambda *what: goals.append(what)
        lost = ['fine', 'silent']  # a read succeeds, and the following write is lost
        tendon.set_faults(['fine', *lost, *lost, *lost])
        tendon.begin(Pull(0.008))
        ((goal, present, _),) = goals
        assert tendon.at_m < 0.006
        assert goal <= present + ON_THE_WAY_COUNTS
    finally:
        tendon.teardown()


def test_a_pull_to_slack_goes_on_when_the_servo_reports_a_fault():
    tendon = Tendon()
    tendon.start(unguarded=False, reads=0.0, reach_m=0.02, found='off', place_mm=1)
    try:
        tendon.disturb_the_bus('refused', 1)
        tendon.report_a_fault()
        tendon.pull_to_slack()  # raises if it fails
    finally:
        tendon.teardown()


class Killed(BaseException):
    """Raised to simulate that the driver is killed."""


@pytest.mark.parametrize('way', ['set-up', 'tripped watchdog', 'homing'])
def test_a_driver_killed_between_any_two_packets_leaves_a_servo_that_the_next_takes_over(way):
    def exchange(*packet):
        nonlocal left
        if not left:
            raise Killed
        left -= 1
        return carry_out(*packet)

    was_killed, count = True, 0
    while was_killed:
        tendon = Tendon()
        tendon.start(unguarded=False, reads=0.0, reach_m=0.02, found='off', place_mm=0)
        try:
            tendon.pass_time_with_everybody_there(5)
            if way == 'set-up':
                tendon.client.close()
                tendon.client = tendon.make_client()
            elif way == 'tripped watchdog':
                tendon.trip_the_watchdog()
            carry_out, left, was_killed = tendon.line.exchange, count, False
            tendon.line.exchange = exchange
            try:
                if way == 'set-up':
                    tendon.connect()
                elif way == 'homing':
                    with tendon.client._servo.bus.lock:
                        tendon.client._servo.write_zero(0.001)
                else:
                    tendon.poll()
            except Killed:
                was_killed = True
            tendon.line.exchange = carry_out
            tendon.client = tendon.make_client()
            tendon.connect()
            assert tendon.servo.table[64]
            assert tendon.servo.table[98] == 10
        finally:
            tendon.teardown()
        count += 1
    assert count > 3


TestTendon = pytest.mark.filterwarnings('ignore')(Tendon.TestCase)
Tendon.TestCase.settings = settings(
    max_examples=SEQUENCES,
    stateful_step_count=40,
    deadline=None,
    # Without Phase.shrink, because each run takes too long.
    phases=[Phase.explicit, Phase.reuse, Phase.generate],
)
