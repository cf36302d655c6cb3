# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Safety of the tendon: a state machine that every command has to pass.

=========  ==================================================  ===========================
state      entered when                                        order to the servo
=========  ==================================================  ===========================
FREE       a pull is admitted; or the tendon becomes slack     follow the pull, then rest
HOLDING    a goal is cancelled; or, with a taut tendon, Stop   hold; nothing tightens
           is pressed or a needed node or topic is lost
RELEASING  the tension is above its limit; or HOLDING after    slacken
           Stop or a loss has lasted ``slack_after_s``
=========  ==================================================  ===========================

A *loss* means that a needed node or topic is lost.

Stop is not a fourth state but a separate latch, `linear_guide_driver.stop_latch.StopLatch`:

==========  =================================  ===============================================
latch       set when                           effect
==========  =================================  ===============================================
stopped     Stop is pressed on any node of     every pull except to slack is refused; a running
            the rig; the emergency stop is     pull ends, unless it slackens; a taut tendon is
            pressed or lost                    held for ``slack_after_s``, then slackened
reset       `StopLatch.reset` is called        none; only the three states apply
==========  =================================  ===============================================

Five rules hold in every state:

1. If the tension is above its limit, the order is to slacken. This depends only on the present
   tension. Neither a stop nor a loss nor a goal can replace this order by another one.
2. Slackening is always admitted and never tightens. Only tightening is checked.
3. A tendon does not stay taut after a loss. It is held for ``slack_after_s`` and then slackened,
   unless a new pull is admitted.
4. While the zero of the displacement is unknown, only homing may tighten.
5. While the latch is set, or a needed node or topic is lost, slackening continues until the
   tendon is slack. It does not end if Stop is pressed again or a goal is cancelled.

A `Watch` monitors a node or topic that motion needs. `TopicWatchdog` monitors the messages of a
topic, `tactile_ros.health.HeartbeatWatch` the DDS liveliness of a node. Both use the monotonic
clock, because ROS time may be simulated, paused or stepped. `linear_guide_driver.tension` provides
the tension.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
import threading
from typing import NamedTuple, Protocol

from linear_guide_driver.config import TendonActuatorConfig
from linear_guide_driver.errors import capitalise, MotionRefusedError
from linear_guide_driver.stop_latch import StopLatch
from linear_guide_driver.tension import TensionSource
from tactile_ros.refusal import Refusal
from tactile_ros.strain import StrainBlock

__all__ = [
    'SLACK_M',
    'Ending',
    'Order',
    'Pull',
    'State',
    'TendonSafety',
    'TopicWatchdog',
    'Watch',
    'Zero',
    'find_loss',
]


class Watch(Protocol):
    """Monitor of a node or topic that motion depends on."""

    @property
    def was_heard(self) -> bool:
        """True once the node or topic has been heard."""

    def find_loss(self, now_ns: int) -> Refusal | None:
        """Return why motion is not allowed at monotonic time ``now_ns`` [ns], or None."""


class TopicWatchdog:
    """Watchdog of the messages on one topic; no IO, thread-safe.

    Parameters
    ----------
    topic : str
        Name of the topic, for messages.
    timeout_s : float
        Time without a message after which the topic counts as silent [s].
    """

    def __init__(self, topic: str, timeout_s: float) -> None:
        self._topic = topic
        self._timeout_ns = round(timeout_s * 1e9)
        self._heard_at_ns: int | None = None

    @property
    def was_heard(self) -> bool:
        """True once a message has arrived."""
        return self._heard_at_ns is not None

    def beat(self, now_ns: int) -> None:
        """Record a message at monotonic time ``now_ns`` [ns]."""
        self._heard_at_ns = now_ns

    def find_loss(self, now_ns: int) -> Refusal | None:
        """Return why the topic counts as silent at monotonic time ``now_ns`` [ns], or None."""
        heard_at_ns = self._heard_at_ns
        if heard_at_ns is None:
            return Refusal(f'No message has arrived on {self._topic} yet', 'start its node')
        if now_ns - heard_at_ns <= self._timeout_ns:
            return None
        return Refusal(
            f'No message has arrived on {self._topic} for {self._timeout_ns / 1e9:g} s',
            'check that its node is running',
        )


def find_loss(watches: Sequence[Watch], now_ns: int) -> Refusal | None:
    """Return the reason of the first watch that does not allow motion, or None.

    ``now_ns`` is the monotonic time [ns].
    """
    for watch in watches:
        if loss := watch.find_loss(now_ns):
            return loss
    return None


# -- the tendon ------------------------------------------------------------------------------

SLACK_M = 0.0005
"""Largest displacement of a slack tendon [m]: the servo's position deviates a little from 0."""

SLACK_SHARE = 0.5
"""If the zero is unknown, a tension below this fraction of ``taut_tension_n`` counts as slack."""

SETTLED_NS = 500_000_000
"""If the sensor reads a tension for this time [ns] where the tendon should be slack, the zero is
wrong. A shorter time would prove nothing, because samples arrive later than positions."""


class State(Enum):
    """State of the tendon's safety; see the table of this module."""

    FREE = 'free'
    HOLDING = 'holding'
    RELEASING = 'releasing'


class Order(Enum):
    """Order to the servo."""

    FOLLOW = 'follow the goal'
    HOLD = 'hold'
    RELEASE = 'slacken'


class Zero(Enum):
    """State of knowledge of the zero of the displacement."""

    KNOWN = 'homed, or taken where the sensor read a slack tendon'
    UNCONFIRMED = 'taken where the tendon came to rest; the sensor has not confirmed it'
    UNKNOWN = 'unknown'


class Ending(Enum):
    """Reason why `TendonSafety` has ended a pull."""

    REACHED = 'the stop tension was reached'
    OVER_LIMIT = 'the limit was exceeded'
    LOST = 'a needed node or topic was lost'
    STOPPED = 'it was stopped on request'


class Pull(NamedTuple):
    """A requested pull."""

    displacement_m: float  # displacement at which the pull ends at the latest [m]
    contact: str = 'flexion'  # key of the tension limits
    stop_tension_n: float = 0.0  # tension at which the pull ends earlier [N]; 0: none
    is_homing: bool = False  # the pull searches for the zero

    @property
    def slackens(self) -> bool:
        """True if the goal is a slack tendon. Such a pull never tightens the tendon."""
        return self.displacement_m <= 0.0 and not self.is_homing


class TendonSafety:
    """State machine of the tendon's safety; no IO and no clock, thread-safe.

    All times are monotonic [ns]. The servo's poll calls `decide` about sixty times a second (less
    often for a slack tendon at rest), and also after each sample that may change the order. The
    poll then executes the order that `decide` has returned.

    Parameters
    ----------
    config : TendonActuatorConfig
        Limits and timeouts.
    watches : sequence of Watch
        Nodes and topics that are needed while the tendon is taut.
    latch : StopLatch, optional
        Stopped state of the rig. By default a latch that is never set.

    Attributes
    ----------
    state : State
        Present state.
    reason : str
        Sentence that says why this state was entered; an empty string after a pull was admitted.
    ending : Ending or None
        Why safety has ended the present pull; None if it has not.
    zero : Zero
        Whether the zero of the displacement is known.
    limit_n : float
        Present tension limit [N].
    tension : TensionSource
        Source of the tension.
    """

    def __init__(
        self,
        config: TendonActuatorConfig,
        watches: Sequence[Watch] = (),
        latch: StopLatch | None = None,
    ) -> None:
        self._config = config
        self._latch = latch or StopLatch()
        self._watches = (self._latch, *watches)  # Stop is reported first
        self._limits_n = config.limits_n
        self._slack_after_ns = round(config.slack_after_s * 1e9)
        self._lock = threading.RLock()
        # The lowest limit applies until the first pull selects a contact.
        self.limit_n = min(self._limits_n.values())
        self.tension = TensionSource(config)
        self._homing_epoch: int | None = None  # ``tension.tare_epoch`` at the start of a homing
        self.state = State.FREE
        self._release_at_ns: int | None = None
        self.reason = ''
        self._loss: str | None = None  # lost node or topic that made the tendon be held
        self._cause = Ending.STOPPED
        self._pull: Pull | None = None
        self._tightens = False
        self.ending: Ending | None = None
        self.zero = Zero.UNKNOWN
        self._zero_reason = 'the driver is not connected'
        self._at_zero_since_ns: int | None = None

    # -- state ---------------------------------------------------------------------------

    @property
    def alarm(self) -> str | None:
        """Why the state was entered; None if the state is FREE or was requested by a command."""
        is_alarm = self.state is not State.FREE and self._cause is not Ending.STOPPED
        return self.reason if is_alarm else None

    @property
    def is_pulling(self) -> bool:
        """True while a pull is running."""
        return self._pull is not None

    @property
    def awaits_first(self) -> bool:
        """True until each needed topic has been heard once."""
        no_sample = self.tension.latest_n is None and not self._config.unguarded
        return no_sample or not all(watch.was_heard for watch in self._watches)

    @property
    def strictest_contact(self) -> str:
        """Name of the contact with the lowest tension limit."""
        return min(self._limits_n, key=self._limits_n.__getitem__)

    @property
    def slack_m(self) -> float:
        """Displacement at which slackening ends [m].

        If the zero is unknown, slackening ends at ``-max_displacement_m``, measured from the
        servo's own zero. If the displacement is already smaller, the tendon is held, because
        slackening never tightens.
        """
        return -self._config.max_displacement_m if self.zero is Zero.UNKNOWN else 0.0

    def is_slack(self, displacement_m: float, now_ns: int) -> bool:
        """Return True if the tendon counts as slack at this displacement [m]."""
        with self._lock:
            if displacement_m <= self.slack_m + SLACK_M:
                return True
            slack_n = SLACK_SHARE * self._config.taut_tension_n
            return self.zero is Zero.UNKNOWN and self.tension.reads_slack(slack_n, now_ns)

    def is_at_rest(self, displacement_m: float, now_ns: int) -> bool:
        """Return True if the tendon is slack at this displacement [m] and nothing moves it."""
        with self._lock:
            is_free = self._pull is None and self.state is State.FREE
            return is_free and self.is_slack(displacement_m, now_ns)

    def find_obstacle(self, displacement_m: float, now_ns: int) -> Refusal | None:
        """Return why no pull may tighten the tendon now, or None."""
        with self._lock:
            obstacle = self._find_zero_obstacle(displacement_m)
            needs_samples = not self._config.unguarded
            return obstacle or self._find_obstacle(needs_samples, self.limit_n, now_ns)

    # -- input -----------------------------------------------------------------------------

    def add_blocks(
        self, blocks: Sequence[StrainBlock], now_ns: int, clock_ns: int | None = None
    ) -> bool:
        """Pass blocks of samples to `TensionSource.add`; return True if the order may change."""
        with self._lock:
            return self._judge_tension(self.tension.add(blocks, now_ns, clock_ns), now_ns)

    def add_current(self, current_a: float, now_ns: int) -> None:
        """Add the motor current [A] of a poll; called before `decide`."""
        with self._lock:
            tightens = self._tightens and self.ending is None
            self.tension.add_current(current_a if tightens else None, now_ns)

    def find_current_limit_a(self, pull: Pull) -> float:
        """Return the largest motor current that is allowed in a pull [A]."""
        config = self._config
        return config.current_limit_a if pull.slackens else config.currents_a[pull.contact]

    def set_zero(self, zero: Zero, reason: str = '') -> None:
        """Set whether the zero is known, and the reason if it is unknown.

        Later samples confirm or refute an unconfirmed zero.
        """
        with self._lock:
            self.zero, self._zero_reason = zero, reason
            self._at_zero_since_ns = None
            if zero is Zero.UNCONFIRMED:
                self.tension.forget()
            elif zero is Zero.KNOWN and self._homing_epoch == self.tension.tare_epoch:
                self.tension.confirm_tare()

    # -- commands --------------------------------------------------------------------------

    def check_pull(self, pull: Pull) -> float:
        """Check contact and stop tension of a pull; return the tension limit of the contact [N].

        Raises
        ------
        MotionRefusedError
            If the contact is unknown or the stop tension is out of range.
        """
        limit_n = self._limits_n.get(pull.contact)
        if limit_n is None:
            names = ', '.join(self._limits_n)
            raise MotionRefusedError(
                f'Contact "{pull.contact}" is unknown; it must be one of {names}.'
            )
        if not 0.0 <= pull.stop_tension_n <= limit_n:
            raise MotionRefusedError(
                f'Stop tension {pull.stop_tension_n} N must be between 0 and the {pull.contact} '
                f'limit of {limit_n} N.'
            )
        return limit_n

    def admit(self, pull: Pull, start_m: float, now_ns: int, fault: Refusal | None = None) -> None:
        """Admit a pull.

        Parameters
        ----------
        pull : Pull
            The requested pull.
        start_m : float
            Present displacement, read under the bus's lock [m]. The pull tightens if its goal is
            larger.
        now_ns : int
            Monotonic time [ns].
        fault : Refusal, optional
            Fault of the servo. If there is one, no pull may tighten.

        Raises
        ------
        MotionRefusedError
            If the pull is not allowed. Nothing is changed.
        """
        with self._lock:
            if not pull.slackens and (stop := self._latch.find_loss(now_ns)):
                raise MotionRefusedError(str(stop))
            limit_n = self.limit_n if pull.slackens else self.check_pull(pull)
            epoch = self.tension.tare_epoch if pull.is_homing else None
            self._confirm_zero(start_m, now_ns)
            tightens = not pull.slackens and (pull.is_homing or pull.displacement_m > start_m)
            if tightens:
                by_zero = (
                    self._find_homing_obstacle(now_ns)
                    if pull.is_homing
                    else self._find_zero_obstacle(start_m)
                )
                needs_samples = self._needs_samples(pull)
                refusal = (
                    fault or by_zero or self._find_obstacle(needs_samples, limit_n, now_ns, epoch)
                )
                if refusal:
                    raise MotionRefusedError(capitalise(str(refusal)))
                self.limit_n = limit_n
                # If a sensor is required, a pull with an unconfirmed zero was refused above.
                # Without a sensor, nothing can confirm the zero, so it counts as known.
                if self.zero is Zero.UNCONFIRMED:
                    self.zero = Zero.KNOWN
            self.limit_n = min(self.limit_n, limit_n)  # only a tightening pull raises the limit
            self._pull, self._tightens, self._homing_epoch = pull, tightens, epoch
            self.state, self._release_at_ns = State.FREE, None
            self.ending, self.reason = None, ''

    def finish(self) -> None:
        """End the pull. The limit and the state remain."""
        with self._lock:
            self._pull, self._tightens = None, False

    def hold(self, now_ns: int) -> None:
        """Request that the tendon is held.

        If the tension is above its limit, `decide` orders to slacken instead. A tendon that is
        being slackened is not held while the rig is stopped, or a needed node or topic is lost.
        """
        with self._lock:
            if self.state is State.HOLDING and self._release_at_ns is not None:
                return  # the tendon is held already, and will be slackened because of a loss
            if self._is_slackening and (loss := self._find_need_loss(now_ns)):
                self._enter(State.RELEASING, f'{loss} The tendon is slackened.', Ending.LOST)
                return
            self._enter(State.HOLDING, 'The tendon was stopped.', Ending.STOPPED)

    def release(self, reason: str) -> None:
        """Request that the tendon is slackened, until it is slack or a pull is admitted."""
        with self._lock:
            self._enter(State.RELEASING, reason, Ending.STOPPED)

    def lose(self, reason: str, now_ns: int) -> None:
        """Hold the tendon and slacken it later, because the servo has stopped by itself.

        A tendon that is being slackened is not held.
        """
        with self._lock:
            if self._pull is not None and not self._tightens:
                self._enter(State.RELEASING, reason, Ending.LOST)
            elif self.state is not State.RELEASING:
                self._hold_then_release(reason, now_ns)

    # -- decision ----------------------------------------------------------------------------

    def decide(self, displacement_m: float, now_ns: int) -> Order:
        """Return the order to the servo at this displacement [m]."""
        with self._lock:
            is_slack = self.is_slack(displacement_m, now_ns)
            if self.tension.is_above(self.limit_n, now_ns):
                self._enter(
                    State.RELEASING,
                    f'{self.tension.format_above(self.limit_n)}: the tendon is slackened.',
                    Ending.OVER_LIMIT,
                )
            elif self.state is not State.FREE and is_slack and self._pull is None:
                self.state, self._release_at_ns = State.FREE, None
            elif self.state is not State.RELEASING:
                if self._release_at_ns is None and (loss := self._find_loss(is_slack, now_ns)):
                    self._hold_then_release(str(loss), now_ns)
                if self._release_at_ns is not None and now_ns >= self._release_at_ns:
                    held_s = self._config.slack_after_s
                    sentence = (
                        f'{self._loss} The tendon was held for {held_s:g} s and is slackened.'
                    )
                    self._enter(State.RELEASING, sentence, Ending.LOST)
            self._confirm_zero(displacement_m, now_ns)
            if self.state is State.RELEASING:
                return Order.RELEASE
            is_held = self.state is State.HOLDING or self.ending is Ending.REACHED
            return Order.HOLD if is_held else Order.FOLLOW

    # -- inside ------------------------------------------------------------------------------

    def _enter(self, state: State, reason: str, ending: Ending) -> None:
        if state is self.state and state is State.RELEASING:
            return
        if state is State.RELEASING:
            self._release_at_ns = None  # a hold that follows does not end in slackening
        self.state, self.reason, self._cause = state, reason, ending
        pull = self._pull
        is_final = self.ending is not None and (self.ending, ending) != (
            Ending.REACHED,
            Ending.OVER_LIMIT,
        )
        if pull is None or is_final:
            return
        if state is State.RELEASING and pull.slackens:
            return  # the pull slackens already
        self.ending = ending

    def _hold_then_release(self, loss: str, now_ns: int) -> None:
        # A second loss changes neither the time of slackening nor the reason.
        if self._release_at_ns is None:
            self._release_at_ns, self._loss = now_ns + self._slack_after_ns, loss
        after_s = self._config.slack_after_s
        sentence = f'{self._loss} The tendon is held and slackened after {after_s:g} s.'
        self._enter(State.HOLDING, sentence, Ending.LOST)

    @property
    def _is_slackening(self) -> bool:
        pull = self._pull if self.ending is None else None
        return self.state is State.RELEASING or (pull is not None and pull.slackens)

    def _judge_tension(self, highest_n: float | None, now_ns: int) -> bool:
        """End a pull whose stop tension is reached; return True if the order may change."""
        if highest_n is None:
            return self.tension.is_above(self.limit_n, now_ns)
        pull = self._pull
        is_reached = (
            pull is not None and self.ending is None and 0.0 < pull.stop_tension_n <= highest_n
        )
        if is_reached:
            self.ending = Ending.REACHED
            self.reason = f'The tension reached {highest_n:.2f} N.'
        return is_reached or self.tension.is_above(self.limit_n, now_ns)

    def _find_loss(self, is_slack: bool, now_ns: int) -> Refusal | None:
        """Return why the tendon must be held (Stop, or a lost node or topic), or None."""
        pull = self._pull if self.ending is None else None
        if pull is not None and not pull.slackens and (stop := self._latch.find_loss(now_ns)):
            return stop
        if not self._tightens and (is_slack or pull is not None):
            return None  # a slack tendon and slackening need no other nodes
        return self._find_need_loss(now_ns)

    def _find_need_loss(self, now_ns: int) -> Refusal | None:
        """Return which of the nodes and topics that a taut tendon needs is lost, or None."""
        if loss := find_loss(self._watches, now_ns):
            return loss
        if not self._needs_samples(self._pull or Pull(0.0)):
            return None
        epoch = self._homing_epoch if self._pull else None
        if self.zero is Zero.UNKNOWN and not self._tightens:
            # While the zero is unknown, an unconfirmed tare does not count as a loss.
            epoch = self.tension.tare_epoch
        return self.tension.find_loss(now_ns, epoch)

    def _confirm_zero(self, displacement_m: float, now_ns: int) -> None:
        """Confirm or refute an unconfirmed zero by the reading of the sensor at this zero."""
        tension = self.tension
        is_at_zero = displacement_m <= SLACK_M
        tension.judge_tare(is_at_zero and self.zero is Zero.KNOWN, now_ns)
        if self.zero is not Zero.UNCONFIRMED or not tension.is_live(now_ns):
            return
        if not is_at_zero or self.state is not State.FREE:
            self._at_zero_since_ns = None
        elif tension.is_below(self._config.taut_tension_n, now_ns):
            self.zero = Zero.KNOWN
            if not tension.tare_epoch:  # a changed tare needs a still reading; see `judge_tare`
                tension.confirm_tare()
        elif self._at_zero_since_ns is None:
            self._at_zero_since_ns = now_ns
        elif now_ns - self._at_zero_since_ns >= SETTLED_NS:
            self.zero = Zero.UNKNOWN
            self._zero_reason = (
                f'the sensor reads {tension.latest_n:.2f} N at the zero, where the tendon should '
                'be slack'
            )

    def _find_zero_obstacle(self, displacement_m: float) -> Refusal | None:
        if self.zero is Zero.UNKNOWN:
            return Refusal(f'The zero is unknown: {self._zero_reason}', 'home the tendon')
        if self.zero is Zero.UNCONFIRMED and displacement_m > SLACK_M:
            return Refusal('The tendon was taut when the driver started', 'slacken it first')
        if self.zero is Zero.UNCONFIRMED and self._at_zero_since_ns is not None:
            return Refusal(
                'The sensor reads tension at the zero of the tendon', 'wait until it is slack'
            )
        return None

    def _find_homing_obstacle(self, now_ns: int) -> Refusal | None:
        """Return a refusal of homing if the reading shows that the tare is wrong, or None."""
        tension_n = self.tension.live_n(now_ns)
        if tension_n is None or tension_n > -self._config.taut_tension_n:
            return None
        return Refusal(
            f'The sensor reads {tension_n:.2f} N, and a tendon cannot push',
            'slacken the tendon and tare the sensor, or change the sign of its scale',
        )

    def _find_obstacle(
        self, needs_samples: bool, limit_n: float, now_ns: int, homing_epoch: int | None = None
    ) -> Refusal | None:
        if loss := find_loss(self._watches, now_ns):
            return loss
        if needs_samples and (loss := self.tension.find_loss(now_ns, homing_epoch)):
            return Refusal(
                f'Tightening needs the tendon sensor. {loss.reason}',
                f'{loss.remedy}. Or set the parameter unguarded to true for plain pulls without '
                'a sensor',
            )
        if self.tension.is_above(limit_n, now_ns):
            return Refusal(self.tension.format_above(limit_n), 'slacken the tendon first')
        return None

    def _needs_samples(self, pull: Pull) -> bool:
        uses_tension = pull.is_homing or pull.stop_tension_n
        return bool(uses_tension) or not self._config.unguarded
