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

"""How a live page is served; free of ROS and of the server."""

from __future__ import annotations

from dataclasses import dataclass, field
import secrets


@dataclass(frozen=True)
class WatchOptions:
    """How the page is served.

    Attributes
    ----------
    host : str
        Address to listen on.
    port : int
        0 takes the usual one, or any that is free.
    token : str
        Needed for what moves. Servers that follow each other with the same options share it.
    """

    host: str = '127.0.0.1'
    port: int = 0
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16))
