# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording of version 0.1 through the nodes of this one."""

from pathlib import Path

from tactile_command import ask_tactile

FOLDER = Path(__file__).parents[1] / 'data' / 'recorded_by_0_1'


def test_nodes_answer_a_recording_of_version_0_1_as_it_was_answered():
    told = ask_tactile('replay', FOLDER / 'recording', '--models', FOLDER / 'models')
    assert told['equal'], told
    compared = told['fingers'][0]['comparisons']
    assert set(compared) == {'recorded and plain core', 'plain core and nodes'}
    for one in compared.values():
        assert not one['left_out']
        assert (one['window_count'], one['classification_count']) == (3, 3)
