# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import itertools

from hypothesis import given
from hypothesis import strategies as st
import pytest

from linear_guide_driver.grbl.protocol import compute_piece_s, cut_move, encode_pieces


def test_a_full_planner_and_receive_buffer_hold_what_was_asked_for():
    # 27 bytes a line: four lines of them wait in 127 bytes.
    assert compute_piece_s(0.25, 15) == pytest.approx(0.25 / 19)
    assert compute_piece_s(0.25, 35) == pytest.approx(0.25 / 39)
    assert compute_piece_s(0.25, 500) == 0.005


def test_the_lines_of_a_move_end_with_a_dwell():
    assert list(encode_pieces(-10.0, -9.0, 50.0, 0.01)) == [
        b'G53 G1 X-9.500 F3000.000\n',
        b'G53 G1 X-9.000 F3000.000\n',
        b'G4 P0.010\n',
    ]


def test_a_move_is_cut_by_hand():
    assert list(cut_move(-10.0, -9.0, 0.4)) == pytest.approx([-9.6667, -9.3333, -9.0], abs=1e-4)
    assert list(cut_move(-10.0, -9.0, 0.5)) == [-9.5, -9.0]
    assert list(cut_move(-10.0, -10.0, 0.5)) == [-10.0]


@given(start=st.floats(-500, 0), end=st.floats(-500, 0), piece=st.floats(0.01, 10))
def test_pieces_go_one_way_are_short_and_end_on_the_target(start, end, piece):
    points = [start, *cut_move(start, end, piece)]
    assert points[-1] == end
    steps = [b - a for a, b in itertools.pairwise(points)]
    assert all(abs(step) <= piece * (1 + 1e-6) for step in steps)
    assert all(step * (end - start) >= 0 for step in steps)
