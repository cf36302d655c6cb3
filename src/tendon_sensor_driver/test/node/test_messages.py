# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from tactile_msgs.msg import StrainBlock
from tactile_ros.strain import StrainStatus


def test_status_bits_are_those_of_the_message():
    constants = {
        name.removeprefix('STATUS_'): getattr(StrainBlock, name)
        for name in dir(type(StrainBlock))
        if name.startswith('STATUS_')
    }
    assert constants == {name: int(bit) for name, bit in StrainStatus.__members__.items()}
    assert len(constants) == 10
