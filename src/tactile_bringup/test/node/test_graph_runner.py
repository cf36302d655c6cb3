# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

import threading

import pytest

from tactile_bringup.launch_config.graph import NodeDescription
from tactile_bringup.nodes.graph_runner import running_graph
from tactile_ros.errors import TactileError

RUNNER = NodeDescription('tactile_bringup', 'trial_runner_node', 'trial_runner', {})


def test_a_callback_that_fails_is_told_at_once_and_at_the_end(context):
    ended = threading.Event()

    def fail():
        raise ZeroDivisionError('a bug')

    def run():
        with running_graph([RUNNER], context, on_end=ended.set) as nodes:
            nodes['trial_runner'].create_timer(0.01, fail)
            assert ended.wait(10.0)

    with pytest.raises(TactileError, match='a node failed and all were ended: a bug'):
        run()
