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

"""Errors that several packages share; free of ROS, so that all can import them."""


class TactileError(Exception):
    """A command, a launch file or a bag cannot do as asked.

    The message is a sentence for the user: what is wrong, with which thing, what to do.
    """


class MessageError(ValueError):
    """A message holds a value that it must not hold, or that is not known here.

    A conversion raises it. The node refuses that message and runs on; see
    `tactile_ros.node.message_guard`.
    """
