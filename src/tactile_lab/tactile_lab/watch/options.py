# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

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
