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

"""What the tests of launch plans share."""

import pytest

from tactile_bringup.launch_config.launch_plans import plan_launch


@pytest.fixture
def launch(tmp_path):
    """Return what gives the plan of a launch file, and its nodes by path."""

    def plan(name, **arguments):
        made = plan_launch(name, {key: str(value) for key, value in arguments.items()}, tmp_path)
        return made, {node.path: node for node in made.nodes}

    return plan
