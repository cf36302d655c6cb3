# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cuts a move into short pieces, because Grbl carries out what it has been given.

Grbl keeps no watch over its line: with the driver dead or the cable cut it goes on to the end
of what is planned. A piece lasts so long that a full planner and a full receive buffer hold
`run_on_s` of motion, and the controller itself sets the pace: it answers a line when there is
room for it. Pieces of one straight line are joined without braking, as long as the next ones
come in time.
"""

from __future__ import annotations

from collections.abc import Iterator
import math

from linear_guide_driver.errors import MotionRefusedError
from linear_guide_driver.grbl import protocol as grbl
from linear_guide_driver.grbl.connection import RECEIVE_BYTES
from linear_guide_driver.records import LinearGuideConfig

SHORTEST_PIECE_S = 0.005
"""Shorter ones keep host and line busy; with more than some 45 planner blocks the controller
therefore runs on for longer than asked."""


def check_reach(config: LinearGuideConfig, position_m: float, speed_m_s: float) -> None:
    """Refuse a move beyond the travel or the greatest speed.

    Raises
    ------
    MotionRefusedError
    """
    if not 0.0 <= position_m <= config.travel_m:
        raise MotionRefusedError(
            f'Position {position_m} m is outside of the travel 0 to {config.travel_m} m.'
        )
    if not 0.0 < speed_m_s <= config.max_speed_m_s:
        raise MotionRefusedError(
            f'Speed {speed_m_s} m/s must be above 0 and at most {config.max_speed_m_s} m/s.'
        )


def mpos_to_m(report: grbl.StatusReport, travel_m: float) -> float | None:
    """Return the position in the guide's frame [m]; None when the report has none."""
    return None if report.mpos_mm is None else report.mpos_mm[0] / 1e3 + travel_m


def compute_piece_s(run_on_s: float, planner_blocks: int) -> float:
    """Return how long one piece of a move lasts [s].

    ``run_on_s`` is the motion that the controller may hold in advance [s], ``planner_blocks``
    how many moves its planner takes.
    """
    waiting_lines = RECEIVE_BYTES // len(grbl.encode_move(-100.0, 1000.0))
    return max(SHORTEST_PIECE_S, run_on_s / (planner_blocks + waiting_lines))


def cut_move(start_mm: float, end_mm: float, piece_mm: float) -> Iterator[float]:
    """Yield where each piece ends [mm], the last one exactly at ``end_mm``.

    ``piece_mm`` is the longest piece [mm].
    """
    pieces = max(1, math.ceil(abs(end_mm - start_mm) / piece_mm - 1e-9))
    for number in range(1, pieces):
        yield start_mm + (end_mm - start_mm) * number / pieces
    yield end_mm


def encode_pieces(
    start_mm: float, end_mm: float, speed_mm_s: float, piece_s: float
) -> Iterator[bytes]:
    """Yield the lines of a move between machine positions [mm, mm/s], a dwell at its end.

    ``piece_s`` is how long one piece lasts [s].
    """
    for mpos_mm in cut_move(start_mm, end_mm, piece_s * speed_mm_s):
        yield grbl.encode_move(mpos_mm, speed_mm_s * 60)
    yield grbl.DWELL
