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

"""What goes wrong in this package."""


class FeatureError(Exception):
    """Root of this package's exceptions."""


class UndefinedFeatureError(FeatureError):
    """A feature has no value on this window, such as the correlation of a constant.

    Attributes
    ----------
    windows : tuple of int
        Of a batch, the places of all windows without a value; otherwise empty or (0,).
    """

    def __init__(self, message: str, windows: tuple[int, ...] = ()) -> None:
        super().__init__(message)
        self.windows = windows
