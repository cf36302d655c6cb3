# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random sequences of everything that can happen to a tendon, on a plant of one line.

The tension is whatever a rule says, however it moves: safety must not rest on a plausible one.
"""

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import initialize, invariant, rule, RuleBasedStateMachine
import pytest

from linear_guide_driver.errors import MotionRefusedError
from linear_guide_driver.records import TendonActuatorConfig
from linear_guide_driver.safety.pull import Pull
from linear_guide_driver.safety.states import Ending, Order, Zero
from linear_guide_driver.safety.tendon_safety import SLACK_M, TendonSafety
from linear_guide_driver.safety.topic_watchdog import TopicWatchdog

POLL_NS = 16_000_000
SPEED_M_S = 0.02
OUT_M_S = 0.05


class Tendon(RuleBasedStateMachine):
    """Carries orders out as the driver does: at each poll, and a command at once."""

    @initialize(unguarded=st.booleans(), reads=st.sampled_from([0.0, 2.0]))
    def start(self, unguarded, reads):
        self.config = TendonActuatorConfig(unguarded=unguarded)
        self.peers = [TopicWatchdog(name, 0.2) for name in ('runner', 'guide')]
        self.safety = TendonSafety(self.config, self.peers)
        self.safety.set_zero(Zero.UNCONFIRMED)
        self.now_ns, self.at_m, self.goal_m, self.speed_m_s = 0, 0.0, 0.0, SPEED_M_S
        self.applied = Order.FOLLOW
        self.pull = None
        self.tension_n, self.sampled_at_ns = 0.0, None
        self.heard_at_ns = {}
        self.lost_since_ns = None
        self.sample(reads)

    # -- the driver ----------------------------------------------------------------------

    def carry_out(self):
        order = self.safety.decide(self.at_m, self.now_ns)
        if order is not self.applied:
            self.write(order)
        return order

    def write(self, order):
        is_slack_early = self.applied is Order.RELEASE and self.safety.zero is Zero.UNKNOWN
        if order is Order.HOLD or (order is Order.FOLLOW and is_slack_early):
            self.goal_m = self.at_m
        elif order is Order.RELEASE:
            self.goal_m, self.speed_m_s = self.safety.slack_m, OUT_M_S
        self.applied = order

    def command(self, order):
        self.applied = Order.FOLLOW
        if self.carry_out() is Order.FOLLOW:
            self.write(order)

    def poll(self):
        step_m = self.speed_m_s * POLL_NS / 1e9
        # At its goal exactly: a difference of tiny numbers would leave it just below.
        lowest_m, highest_m = self.at_m - step_m, self.at_m + step_m
        self.at_m = max(lowest_m, min(highest_m, self.goal_m))
        self.now_ns += POLL_NS
        self.carry_out()
        if self.pull and (self.safety.ending or self.at_m == self.goal_m):
            self.carry_out()
            self.safety.finish()
            self.pull = None
        self.note_loss()

    # -- what happens --------------------------------------------------------------------

    @rule(polls=st.integers(1, 25))
    def pass_time(self, polls):
        for _ in range(polls):
            self.poll()

    @rule(polls=st.integers(1, 200))
    def pass_time_with_everybody_there(self, polls):
        for _ in range(polls):
            self.sample(self.tension_n)
            self.beat(0)
            self.beat(1)
            self.poll()

    @rule(gap_s=st.floats(0.1, 30.0))
    def sleep_of_the_host(self, gap_s):
        self.now_ns += round(gap_s * 1e9)
        self.poll()

    @rule(tension_n=st.sampled_from([0.0, 0.1, 1.0, 2.9, 3.1, 10.0, 15.1, 25.0, -20.0]))
    def sample(self, tension_n):
        self.tension_n, self.sampled_at_ns = tension_n, self.now_ns
        if self.safety.add_samples([tension_n], False, self.now_ns):
            self.carry_out()

    @rule(which=st.integers(0, 1))
    def beat(self, which):
        self.peers[which].beat(self.now_ns)
        self.heard_at_ns[which] = self.now_ns

    @rule(
        displacement_m=st.floats(0.0, 0.02),
        contact=st.sampled_from(['flexion', 'abduction']),
        stop_n=st.sampled_from([0.0, 2.0]),
        is_homing=st.booleans(),
    )
    def ask(self, displacement_m, contact, stop_n, is_homing):
        if self.pull:
            return
        pull = Pull(displacement_m, contact, stop_n, is_homing=is_homing)
        lets_out = not is_homing and displacement_m <= max(0.0, self.at_m)
        try:
            self.safety.admit(pull, self.at_m, self.now_ns)
        except MotionRefusedError:
            assert not lets_out, 'letting out was refused'
            return
        self.pull = pull
        self.lost_since_ns = None
        if self.safety.decide(self.at_m, self.now_ns) is Order.FOLLOW:
            self.goal_m, self.speed_m_s = displacement_m, SPEED_M_S
            self.applied = Order.FOLLOW
        else:
            self.carry_out()

    @rule()
    def stop(self):
        self.lost_since_ns = None  # a stop that ends a release begins the holding time anew
        self.safety.stop()
        self.command(Order.HOLD)

    @rule()
    def release(self):
        self.safety.release('The tendon was released.')
        self.command(Order.RELEASE)

    @rule()
    def servo_stops_by_itself(self):
        if self.pull:
            self.safety.lose("The servo's watchdog has stopped it.", self.now_ns)
        self.goal_m = self.at_m
        self.applied = Order.FOLLOW
        self.carry_out()

    # -- what must hold ------------------------------------------------------------------

    @property
    def is_live(self):
        return (
            self.sampled_at_ns is not None
            and self.now_ns - self.sampled_at_ns <= self.config.guard_timeout_s * 1e9
        )

    @property
    def are_peers_heard(self):
        return len(self.heard_at_ns) == 2 and all(
            self.now_ns - at_ns <= 200_000_000 for at_ns in self.heard_at_ns.values()
        )

    def note_loss(self):
        is_lost = not self.are_peers_heard or not (self.is_live or self.config.unguarded)
        is_taut = self.at_m > SLACK_M
        if not (is_lost and is_taut) or (self.pull and self.pull.displacement_m <= self.at_m):
            self.lost_since_ns = None
        elif self.lost_since_ns is None:
            self.lost_since_ns = self.now_ns

    @invariant()
    def above_the_limit_the_tendon_is_let_out(self):
        if not hasattr(self, 'safety'):
            return
        if self.is_live and abs(self.tension_n) > self.safety.limit_n:
            assert self.carry_out() is Order.RELEASE
            assert self.goal_m <= 0.0

    @invariant()
    def only_what_may_wind_in_winds_in(self):
        if not hasattr(self, 'safety') or self.goal_m <= max(self.at_m, 0.0):
            return
        self.carry_out()
        if self.goal_m <= self.at_m:
            return
        assert self.pull is not None, 'something winds in without a pull'
        assert self.pull.is_homing or self.safety.zero is Zero.KNOWN
        assert self.are_peers_heard
        assert self.is_live or (self.config.unguarded and not self.pull.stop_tension_n)
        assert self.safety.ending in (None, Ending.STOPPED)

    @invariant()
    def a_taut_tendon_that_lacks_something_ends_up_slack(self):
        if not hasattr(self, 'safety') or self.lost_since_ns is None:
            return
        if self.safety.is_slack(self.at_m, self.now_ns):  # without a zero, by the sensor
            return
        if self.now_ns - self.lost_since_ns > self.config.slack_after_s * 1e9 + 2 * POLL_NS:
            assert self.carry_out() is Order.RELEASE


TestTendon = pytest.mark.filterwarnings('ignore')(Tendon.TestCase)
Tendon.TestCase.settings = settings(max_examples=100, stateful_step_count=40, deadline=None)
