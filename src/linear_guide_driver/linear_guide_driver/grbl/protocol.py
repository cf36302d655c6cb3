# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Protocol of Grbl 1.1: encoding of commands, decoding of answers, and texts of codes.

No IO and no clock. A move is divided into short pieces, because Grbl does not monitor its serial
connection: if the driver dies or the cable is cut, it executes all planned motion. The duration
of a piece is chosen so that a full planner and a full receive buffer contain ``run_on_s`` of
motion. The controller sets the pace, because it answers a line only when it has room for the
motion. Grbl joins pieces of a straight line without braking if the next pieces arrive in time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
import math
import re

from linear_guide_driver.config import LinearGuideConfig
from linear_guide_driver.errors import DeviceRefusedError

STATUS_QUERY = b'?'
FEED_HOLD = b'!'
CYCLE_START = b'~'
SOFT_RESET = b'\x18'
FEED_OVERRIDE_RESET = b'\x90'
"""This and the four constants above are real-time commands: single bytes that Grbl executes
immediately, even within a line."""

HOME = b'$H\n'
READ_SETTINGS = b'$$\n'
READ_BUILD_INFO = b'$I\n'

MODES = b'G21 G90 G94\n'
"""Line that selects millimetres, absolute positions and feed per minute."""

DWELL = b'G4 P0.010\n'
"""A pause of 10 ms. Grbl answers it with ``ok`` only after all earlier motion has ended."""

MAX_LINE_BYTES = 512
"""Longest valid line of a controller. The longest known line, a build info, has 150 bytes."""

RECEIVE_BYTES = 127
"""Largest number of bytes in unanswered lines; Grbl's receive buffer has 128 bytes."""

SHORTEST_PIECE_S = 0.005
"""Shortest duration of a piece of a move [s]. Shorter pieces would load host and connection.

A controller with more than about 45 planner blocks therefore keeps moving for longer than
``run_on_s`` after its driver has died."""

STATES = frozenset(
    {'Idle', 'Run', 'Hold', 'Jog', 'Alarm', 'Door', 'Check', 'Home', 'Sleep', 'Tool'}
)
"""Machine states of a status report; only grblHAL has the state Tool."""

ERRORS = {
    1: 'a word has no letter',
    2: 'a number is missing or malformed',
    3: 'unknown $ command',
    4: 'the value is negative',
    5: 'homing is switched off',
    6: 'the step pulse is too short',
    7: 'the EEPROM could not be read; defaults are in use',
    8: 'the command needs an idle controller',
    9: 'G-code is locked by an alarm or a jog',
    10: 'soft limits need homing switched on',
    11: 'the line is too long',
    12: 'the step rate is too high',
    13: 'the safety door is open',
    14: 'the line is too long to be stored',
    20: 'unknown or unsupported word',
    21: 'two words of one modal group',
    22: 'no feed rate was given',
    23: 'a word needs an integer value',
    24: 'two commands want the axis words',
    25: 'a word is repeated',
    26: 'axis words are missing',
    28: 'a required word is missing',
    30: 'G53 needs G0 or G1',
    31: 'axis words without a command that uses them',
    33: 'the target is not valid',
    36: 'words are left over',
}
"""Meaning of the error codes with which Grbl may answer intact or damaged lines of the driver."""

ALARMS = {
    1: 'hard limit: a limit switch was hit',
    2: 'soft limit: the target leaves the travel',
    3: 'reset while moving: the position is lost',
    6: 'homing was ended by a reset',
    7: 'the safety door opened during homing',
    8: 'homing did not clear the limit switch',
    9: 'homing did not find the limit switch',
    10: 'homing did not find the second limit switch of a dual axis',
}

_NO_CODE = 'see the codes of Grbl 1.1'


# -- events --------------------------------------------------------------------------


@dataclass(frozen=True)
class Ok:
    """A command line was accepted; a move is then planned, not finished."""


@dataclass(frozen=True)
class Error:
    """A command line was refused."""

    code: int

    def __str__(self) -> str:
        return f'error:{self.code} ({ERRORS.get(self.code, _NO_CODE)})'


@dataclass(frozen=True)
class Alarm:
    """The controller has locked itself."""

    code: int

    def __str__(self) -> str:
        return f'ALARM:{self.code} ({ALARMS.get(self.code, _NO_CODE)})'


@dataclass(frozen=True)
class StatusReport:
    """Answer to a status query."""

    state: str  # one of `STATES`
    substate: int | None = None  # number after the state: Hold:0 is at rest, Hold:1 still braking
    # Machine position of each axis. None if the report contains the work position and the work
    # offset is not known yet.
    mpos_mm: tuple[float, ...] | None = None
    feed_mm_min: float | None = None  # present speed


@dataclass(frozen=True)
class Setting:
    """One line of the answer to ``$$``."""

    number: int
    value: str


@dataclass(frozen=True)
class Banner:
    """The controller has just started."""

    version: str
    is_hal: bool = False


@dataclass(frozen=True)
class Message:
    """Text from the controller: ``[...]`` without its brackets, or a start-up line."""

    text: str


Event = Ok | Error | Alarm | StatusReport | Setting | Banner | Message


# -- commands -------------------------------------------------------------------------


def encode_move(mpos_mm: float, feed_mm_min: float) -> bytes:
    """Return a straight move of the X axis to a machine position [mm] at a speed [mm/min].

    With G53 the move does not depend on work offsets, which the controller stores permanently.
    """
    return f'G53 G1 X{mpos_mm:.3f} F{feed_mm_min:.3f}\n'.encode()


def compute_piece_s(run_on_s: float, planner_blocks: int) -> float:
    """Return the duration of one piece of a move [s].

    With this duration, the controller receives ``run_on_s`` [s] of motion in advance.
    """
    waiting_lines = RECEIVE_BYTES // len(encode_move(-100.0, 1000.0))
    return max(SHORTEST_PIECE_S, run_on_s / (planner_blocks + waiting_lines))


def cut_move(start_mm: float, end_mm: float, piece_mm: float) -> Iterator[float]:
    """Yield the end of each piece [mm]; pieces are at most ``piece_mm`` long."""
    pieces = max(1, math.ceil(abs(end_mm - start_mm) / piece_mm - 1e-9))
    for number in range(1, pieces):
        yield start_mm + (end_mm - start_mm) * number / pieces
    yield end_mm


def encode_pieces(
    start_mm: float, end_mm: float, speed_mm_s: float, piece_s: float
) -> Iterator[bytes]:
    """Yield the lines of a move in pieces of ``piece_s`` [s], followed by a dwell."""
    for mpos_mm in cut_move(start_mm, end_mm, piece_s * speed_mm_s):
        yield encode_move(mpos_mm, speed_mm_s * 60)
    yield DWELL


# -- replies --------------------------------------------------------------------------


_NUMBER = r'-?\d{1,9}(?:\.\d{1,6})?'
_REPLY = re.compile(r'(error|ALARM):(\d{1,3})')
_SETTING = re.compile(r'\$(\d{1,5})=([!-~]*)')
_BANNER = re.compile(r'Grbl(HAL)? (\d[!-~]*)(?: .*)?')
_STATE = re.compile(r'([A-Z][a-z]+)(?::(\d{1,3}))?')
_AXES = re.compile(rf'{_NUMBER}(?:,{_NUMBER}){{0,7}}')
_FIELD = re.compile(r'([A-Za-z]+):([!-~]*)')


class GrblDecoder:
    """Incremental decoder of the controller's answers.

    Invalid lines are dropped and counted in ``garbage_lines``.
    """

    def __init__(self) -> None:
        self.garbage_lines = 0
        self._partial = bytearray()
        self._overlong = False
        self._wco_mm: tuple[float, ...] | None = None

    def feed(self, data: bytes) -> list[Event]:
        """Decode the next bytes; return the events of the lines that they complete."""
        events: list[Event] = []
        *ends, rest = data.split(b'\n')
        for piece in ends:
            self._append(piece)
            event = None if self._overlong else self._decode_line(bytes(self._partial))
            if event is not None:
                events.append(event)
            elif self._overlong or self._partial.strip():
                self.garbage_lines += 1
            self._partial.clear()
            self._overlong = False
        self._append(rest)
        return events

    def _append(self, piece: bytes) -> None:
        if len(self._partial) + len(piece) > MAX_LINE_BYTES:
            self._overlong = True
            self._partial.clear()
        if not self._overlong:
            self._partial += piece

    def _decode_line(self, line: bytes) -> Event | None:
        try:
            text = line.removesuffix(b'\r').decode('ascii')
        except UnicodeDecodeError:
            return None
        if text == 'ok':
            return Ok()
        if match := _REPLY.fullmatch(text):
            code = int(match[2])
            return Error(code) if match[1] == 'error' else Alarm(code)
        if match := _SETTING.fullmatch(text):
            return Setting(int(match[1]), match[2])
        if match := _BANNER.fullmatch(text):
            self._wco_mm = None
            return Banner(match[2], is_hal=match[1] is not None)
        if not text.isprintable():
            return None
        if text[:1] == '<' and text[-1:] == '>':
            return self._decode_status(text[1:-1])
        if text[:1] == '[' and text[-1:] == ']':
            return Message(text[1:-1])
        if text[:1] == '>' and ':' in text:
            return Message(text)
        return None

    def _decode_status(self, text: str) -> StatusReport | None:
        first, *rest = text.split('|')
        state = _STATE.fullmatch(first)
        matches = [_FIELD.fullmatch(field) for field in rest]
        if state is None or state[1] not in STATES or None in matches:
            return None
        fields = {match[1]: match[2] for match in matches if match is not None}
        positions: dict[str, tuple[float, ...]] = {}
        for name in ('MPos', 'WPos', 'WCO'):
            if name in fields:
                if not _AXES.fullmatch(fields[name]):
                    return None
                positions[name] = tuple(float(value) for value in fields[name].split(','))
        if ('MPos' in positions) == ('WPos' in positions):
            return None
        feed_text = fields.get('FS', fields.get('F'))
        if feed_text is not None and not _AXES.fullmatch(feed_text):
            return None
        if 'WCO' in positions:
            self._wco_mm = positions['WCO']
        mpos, offset = positions.get('MPos'), self._wco_mm
        if mpos is None and offset is not None and len(offset) == len(positions['WPos']):
            mpos = tuple(w + o for w, o in zip(positions['WPos'], offset, strict=True))
        return StatusReport(
            state=state[1],
            substate=None if state[2] is None else int(state[2]),
            mpos_mm=mpos,
            feed_mm_min=None if feed_text is None else float(feed_text.split(',')[0]),
        )


TRAVEL_TOLERANCE_MM = 0.5

FEWEST_STEPS_PER_MM = 20.0
"""Smallest number of steps per millimetre. If steps are longer than 0.05 mm, they disturb the
signal of a glide, and moves miss their targets."""

MOST_STEPS_HZ = 30e3
"""Highest step rate of Grbl on an 8-bit board [Hz]; grblHAL runs on faster boards."""


@dataclass(frozen=True)
class GuideSettings:
    """Settings of the X axis, in Grbl's units. The comments contain their numbers in Grbl."""

    reports_inches: bool  # $13
    has_soft_limits: bool  # $20
    has_homing: bool  # $22
    homing_feed_mm_min: float  # $24
    homing_seek_mm_min: float  # $25
    pull_off_mm: float  # $27
    steps_per_mm: float  # $100
    max_rate_mm_min: float  # $110
    acceleration_mm_s2: float  # $120
    travel_mm: float  # $130

    @classmethod
    def from_lines(cls, values: Mapping[int, str]) -> GuideSettings:
        """Convert the answer to ``$$``; raise DeviceRefusedError for missing or invalid values."""

        def number(index: int, is_positive: bool = True) -> float:
            try:
                value = float(values[index])
            except (KeyError, ValueError):
                value = float('nan')
            if not (0.0 < value < 1e9 if is_positive else 0.0 <= value < 1e9):
                raise DeviceRefusedError(
                    f"the controller's setting ${index} is {values.get(index, 'missing')}; "
                    f'restore the settings of the controller'
                )
            return value

        return cls(
            reports_inches=number(13, False) != 0,
            has_soft_limits=number(20, False) != 0,
            has_homing=int(number(22, False)) & 1 == 1,  # a bit mask in grblHAL; bit 0 as in Grbl
            homing_feed_mm_min=number(24),
            homing_seek_mm_min=number(25),
            pull_off_mm=number(27, False),
            steps_per_mm=number(100),
            max_rate_mm_min=number(110),
            acceleration_mm_s2=number(120),
            travel_mm=number(130),
        )

    def check(
        self, config: LinearGuideConfig, build_options: str, *, is_hal: bool = False
    ) -> None:
        """Check the settings against the configuration.

        Parameters
        ----------
        config : LinearGuideConfig
            Travel and speed of the guide.
        build_options : str
            Letters of the controller's ``[OPT:`` message.
        is_hal : bool
            The controller runs grblHAL.

        Raises
        ------
        DeviceRefusedError
            If a setting would make a motion differ from the request, without an error.
        """
        if self.reports_inches:
            raise DeviceRefusedError('the controller reports inches; set $13=0')
        if not self.has_homing:
            raise DeviceRefusedError('homing is switched off in the controller; set $22=1')
        if not self.has_soft_limits:
            raise DeviceRefusedError('soft limits are switched off in the controller; set $20=1')
        if 'Z' in build_options:
            raise DeviceRefusedError(
                'the firmware sets its origin at the homing switch (option Z), which reverses the '
                'travel; build the firmware without HOMING_FORCE_SET_ORIGIN'
            )
        fastest_mm_min = config.max_speed_m_s * 60e3
        if self.max_rate_mm_min < fastest_mm_min * (1 - 1e-9):
            raise DeviceRefusedError(
                f'the controller limits the speed to {self.max_rate_mm_min:g} mm/min, below '
                f'max_speed_m_s = {config.max_speed_m_s:g}; set $110={fastest_mm_min:g} or '
                f'max_speed_m_s to {self.max_rate_mm_min / 60e3:g}'
            )
        if self.steps_per_mm < FEWEST_STEPS_PER_MM:
            raise DeviceRefusedError(
                f'the controller has {self.steps_per_mm:g} steps per millimetre, too few for a '
                f'glide; increase the micro-stepping, and set $100 accordingly, to '
                f'{FEWEST_STEPS_PER_MM:g} or more'
            )
        steps_hz = fastest_mm_min / 60 * self.steps_per_mm
        if steps_hz > MOST_STEPS_HZ and not is_hal:
            raise DeviceRefusedError(
                f'max_speed_m_s = {config.max_speed_m_s:g} needs {steps_hz:.0f} steps/s, but Grbl '
                f'reaches {MOST_STEPS_HZ:.0f}; reduce max_speed_m_s, or the micro-stepping and '
                '$100'
            )
        if abs(self.travel_mm - config.travel_m * 1e3) > TRAVEL_TOLERANCE_MM:
            raise DeviceRefusedError(
                f"the controller's travel is {self.travel_mm:g} mm, but travel_m is "
                f'{config.travel_m:g}; set $130={config.travel_m * 1e3:g} or travel_m to '
                f'{self.travel_mm / 1e3:g}'
            )

    def compute_move_duration_s(self, distance_m: float, speed_m_s: float) -> float:
        """Return an upper bound of the duration of a move from rest to rest [s].

        With distance d, speed v and acceleration a, the bound is d/v + v/a. It is exact if the
        move reaches its speed.
        """
        return abs(distance_m) / speed_m_s + speed_m_s * 1e3 / self.acceleration_mm_s2

    def compute_homing_timeout_s(self) -> float:
        """Return the longest duration of a homing cycle [s].

        Grbl seeks the switch over 1.5 times the travel. It then approaches the switch again, over
        a few times the pull-off distance.
        """
        seek_s = 1.5 * self.travel_mm / (self.homing_seek_mm_min / 60)
        locate_s = 10 * self.pull_off_mm / (self.homing_feed_mm_min / 60)
        return seek_s + locate_s + self.homing_seek_mm_min / 60 / self.acceleration_mm_s2
