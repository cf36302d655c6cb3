# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Grbl 1.1 over a serial line: commands to bytes, bytes to events.

No IO and no clock. Both directions of the replies are here, because the
simulated controller writes what this module reads.
"""

from __future__ import annotations

from dataclasses import dataclass
import re

from linear_guide_driver.grbl.codes import describe_alarm, describe_error, STATES

STATUS_QUERY = b'?'
FEED_HOLD = b'!'
CYCLE_START = b'~'
SOFT_RESET = b'\x18'
FEED_OVERRIDE_RESET = b'\x90'
"""Real-time bytes: no newline, acted on at once, even in the middle of a line."""

HOME = b'$H\n'
READ_SETTINGS = b'$$\n'
READ_BUILD_INFO = b'$I\n'

MODES = b'G21 G90 G94\n'
"""Millimetres, absolute positions, feed per minute."""

DWELL = b'G4 P0.010\n'
"""A pause; its ``ok`` comes only when all motion before it has ended."""

MAX_LINE_BYTES = 512
"""Longer lines are no Grbl; the longest known is a build info line of some 150 bytes."""


# -- events --------------------------------------------------------------------------


@dataclass(frozen=True)
class Ok:
    """A command line was taken; for a move that means planned, not done."""


@dataclass(frozen=True)
class Error:
    """A command line was refused."""

    code: int

    def __str__(self) -> str:
        return describe_error(self.code)


@dataclass(frozen=True)
class Alarm:
    """The controller has locked itself."""

    code: int

    def __str__(self) -> str:
        return describe_alarm(self.code)


@dataclass(frozen=True)
class StatusReport:
    """One answer to ``?``.

    Attributes
    ----------
    state : str
        One of `grbl_codes.STATES`.
    substate : int or None
        The number after the state: Hold:0 is at rest, Hold:1 still braking.
    mpos_mm, wpos_mm : tuple of float or None
        Machine and work position, one value an axis [mm]. A report holds one of
        the two; the decoder adds the other once it knows the work offset.
    feed_mm_min : float or None
        Speed now [mm/min].
    """

    state: str
    substate: int | None = None
    mpos_mm: tuple[float, ...] | None = None
    wpos_mm: tuple[float, ...] | None = None
    feed_mm_min: float | None = None


@dataclass(frozen=True)
class Setting:
    """One line of ``$$``; the value as it was written."""

    number: int
    value: str


@dataclass(frozen=True)
class Banner:
    """The controller has just started."""

    version: str
    is_hal: bool = False


@dataclass(frozen=True)
class Message:
    """Text pushed by the controller: ``[...]`` without its brackets, or a start-up line."""

    text: str


Event = Ok | Error | Alarm | StatusReport | Setting | Banner | Message


# -- commands -------------------------------------------------------------------------


def encode_move(mpos_mm: float, feed_mm_min: float) -> bytes:
    """Return a straight move of the X axis.

    Parameters
    ----------
    mpos_mm : float
        Target in machine coordinates [mm]; G53 makes it independent of work offsets,
        which the controller remembers over power cycles.
    feed_mm_min : float
        Speed [mm/min].
    """
    return f'G53 G1 X{mpos_mm:.3f} F{feed_mm_min:.3f}\n'.encode()


# -- replies --------------------------------------------------------------------------


_NUMBER = r'-?\d{1,9}(?:\.\d{1,6})?'
_REPLY = re.compile(r'(error|ALARM):(\d{1,3})')
_SETTING = re.compile(r'\$(\d{1,5})=([!-~]*)')
_BANNER = re.compile(r'Grbl(HAL)? (\d[!-~]*)(?: .*)?')
_STATE = re.compile(r'([A-Z][a-z]+)(?::(\d{1,3}))?')
_AXES = re.compile(rf'{_NUMBER}(?:,{_NUMBER}){{0,7}}')
_FIELD = re.compile(r'([A-Za-z]+):([!-~]*)')


class GrblDecoder:
    """Turns bytes, in any chunking, into events.

    A line that is not Grbl's is counted and dropped, never guessed at.

    Attributes
    ----------
    garbage_lines : int
        Lines dropped so far.
    """

    def __init__(self) -> None:
        self.garbage_lines = 0
        self._partial = bytearray()
        self._overlong = False
        self._wco_mm: tuple[float, ...] | None = None

    def feed(self, data: bytes) -> list[Event]:
        """Take bytes; return the events of the lines that they complete."""
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
        mpos, wpos = positions.get('MPos'), positions.get('WPos')
        offset = self._wco_mm
        if offset is not None and len(offset) == len(mpos or wpos or ()):
            if mpos is None and wpos is not None:
                mpos = tuple(w + o for w, o in zip(wpos, offset, strict=True))
            elif mpos is not None:
                wpos = tuple(m - o for m, o in zip(mpos, offset, strict=True))
        return StatusReport(
            state=state[1],
            substate=None if state[2] is None else int(state[2]),
            mpos_mm=mpos,
            wpos_mm=wpos,
            feed_mm_min=None if feed_text is None else float(feed_text.split(',')[0]),
        )
