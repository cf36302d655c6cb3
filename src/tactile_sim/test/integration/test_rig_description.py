# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A user's folder of descriptions, down to the rig's process."""

import pytest

from tactile_sim import RigError, SimulatedRig


def test_a_bad_description_is_the_reason_why_the_rig_does_not_start(tmp_path):
    (tmp_path / 'rig.yaml').write_text('load_cell: {noise_n: loud}')
    with pytest.raises(RigError, match=r"rig\.yaml\.load_cell\.noise_n is 'loud'; it must be"):
        SimulatedRig(description=tmp_path)


def test_a_users_plate_can_be_mounted(tmp_path):
    (tmp_path / 'plates.yaml').write_text(
        'mine: {groove: profile, end_mm: 10, grooved_mm: 2, friction: 0.4, '
        'points_mm: [[0, 0], [1, -1], [2, 0]]}'
    )
    with SimulatedRig(description=tmp_path) as rig:
        assert rig.mount('texture', 'mine', 'flexion')['object'] == 'mine'
    with SimulatedRig() as rig, pytest.raises(RigError, match="'mine'"):
        rig.mount('texture', 'mine', 'flexion')
