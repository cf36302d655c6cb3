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

"""What the motion drivers raise."""


class LinearGuideDriverError(Exception):
    """Root of the package's errors; the message is one sentence with the remedy."""


class DeviceConnectionError(LinearGuideDriverError):
    """The device cannot be reached, or the line to it was lost."""


class DeviceRefusedError(LinearGuideDriverError):
    """The device answers but refuses, or is set up so that it must not be used."""


class MotionRefusedError(LinearGuideDriverError):
    """The motion was not started."""


class MotionFailedError(LinearGuideDriverError):
    """The motion was started and ended by a fault."""


class MotionStoppedError(LinearGuideDriverError):
    """The motion was started and ended early because somebody asked for it."""
