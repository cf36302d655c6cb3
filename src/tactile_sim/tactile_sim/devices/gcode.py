# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parser of G-code, limited to the commands of Grbl that a guide with one axis needs."""

from __future__ import annotations

from dataclasses import dataclass
import re

_match_word = re.compile(r'([A-Z])([+-]?(?:\d+\.?\d*|\.\d+))?').match

_MODAL_GROUPS = {
    '0': 'motion',
    '1': 'motion',
    '4': 'dwell',
    '21': 'units',
    '53': 'machine',
    '54': 'offset',
    '90': 'distance',
    '91': 'distance',
    '94': 'feed',
}


class GcodeError(Exception):
    """A line of G-code is invalid. Grbl answers it with ``error:`` and the code."""

    def __init__(self, code: int) -> None:
        super().__init__(f'error:{code}')
        self.code = code


@dataclass
class Modal:
    """Modal state of the G-code parser: values that remain valid for the following lines."""

    motion: str = '0'
    distance: str = '90'
    feed_mm_min: float = 0.0


@dataclass(frozen=True)
class Command:
    """The move or the dwell that one line of G-code commands.

    ``target_mm`` is the machine coordinate X at the end of the move [mm]; None without a move. If
    ``feed_mm_min`` [mm/min] is None, the move has the maximum speed (G0). A dwell of ``dwell_s``
    [s] begins when all motion has ended.
    """

    target_mm: float | None = None
    feed_mm_min: float | None = None
    dwell_s: float | None = None


def parse_gcode(line: str, modal: Modal, position_mm: float) -> Command:
    """Parse one line that `strip_line` has returned, and update ``modal``.

    ``position_mm`` is the machine coordinate at the end of all planned motion. Relative moves
    (G91) start there. Raises `GcodeError` when the line is invalid; ``modal`` is then unchanged.
    """
    groups, values = _read_words(line)
    motion = groups.get('motion', modal.motion)
    distance = groups.get('distance', modal.distance)
    feed = values.get('F', modal.feed_mm_min)
    if 'dwell' in groups and ('X' in values or 'motion' in groups):
        raise GcodeError(24 if 'X' in values else 21)
    if 'dwell' in groups and 'P' not in values:
        raise GcodeError(28)
    if 'P' in values and 'dwell' not in groups:
        raise GcodeError(36)
    if 'X' in values and motion == '1' and feed == 0.0:
        raise GcodeError(22)
    modal.motion, modal.distance, modal.feed_mm_min = motion, distance, feed
    if 'dwell' in groups:
        return Command(dwell_s=values['P'])
    if 'X' not in values:
        return Command()
    relative = distance == '91' and 'machine' not in groups
    target = values['X'] + (position_mm if relative else 0.0)
    return Command(target, feed if motion == '1' else None)


def _read_words(line: str) -> tuple[dict[str, str], dict[str, float]]:
    groups: dict[str, str] = {}
    values: dict[str, float] = {}
    at = 0
    while at < len(line):
        word = _match_word(line, at)
        if word is None:
            raise GcodeError(1)
        letter, number = word.groups()
        if number is None:
            raise GcodeError(2)
        at = word.end()
        if letter == 'G':
            number = f'{float(number):g}'
            group = _MODAL_GROUPS.get(number)
            if group is None:
                raise GcodeError(20)
            if group in groups:
                raise GcodeError(21)
            groups[group] = number
        elif letter in 'XFPN':
            if letter in values:
                raise GcodeError(25)
            values[letter] = float(number)
            if letter != 'X' and values[letter] < 0.0:
                raise GcodeError(4)
        else:
            raise GcodeError(20)
    values.pop('N', None)
    return groups, values


def strip_line(line: str) -> str:
    """Return the line in capitals, without spaces and comments, as Grbl stores it."""
    kept, depth = [], False
    for character in line:
        if depth:
            depth = character != ')'
        elif character == '(':
            depth = True
        elif character == ';':
            break
        elif character > ' ':
            kept.append(character.upper())
    return ''.join(kept)
