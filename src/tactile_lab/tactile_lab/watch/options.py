# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Server options of the live page; free of ROS and of the server."""

from __future__ import annotations

from dataclasses import dataclass, field
import secrets


@dataclass(frozen=True)
class WatchOptions:
    """Address and port to listen on, and the token that moving needs.

    Port 0 takes the usual one, or any that is free. Servers that follow each other with the same
    options share the token.
    """

    host: str = '127.0.0.1'
    port: int = 0
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16))
