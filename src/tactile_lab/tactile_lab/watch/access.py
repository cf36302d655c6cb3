# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Access rules of the live page: which requests and commands are accepted."""

from __future__ import annotations

from dataclasses import dataclass, field
import ipaddress
import json
import secrets
from urllib.parse import urlsplit

from tactile_bringup.trial_protocols import ProtocolError, TrialRequest
from tactile_ros.errors import TactileError

ACTIONS = ('stop', 'release', 'reset', 'tare', 'home', 'trial')

OF_ALL_FINGERS = ('stop', 'release', 'reset')
"""Actions that apply to all fingers; their commands need no name of a finger."""

LONGEST_COMMAND = 4096
LONGEST_NAME = 200

HEADERS = {
    'Content-Security-Policy': "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    'X-Content-Type-Options': 'nosniff',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Referrer-Policy': 'no-referrer',
    'Cache-Control': 'no-store',
}
"""Headers of every response. They forbid external content, and embedding in other pages."""


@dataclass(frozen=True)
class WatchOptions:
    """Address and port of the live page, and the token that commands require, except Stop.

    Port 0 selects the default port, or any free port if the default one is in use. Servers that
    are started with the same options one after the other have the same token.
    """

    host: str = '127.0.0.1'
    port: int = 0
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16))


class CommandError(TactileError):
    """A page has sent an invalid command; the message states the reason."""


@dataclass(frozen=True)
class Command:
    """A command from a page.

    ``action`` is one of `ACTIONS`, and ``finger`` a namespace, which actions in `OF_ALL_FINGERS`
    ignore. ``token`` is from the address of the page. The message about the result of the command
    has the same ``id``.
    """

    action: str
    finger: str = ''
    trial: TrialRequest | None = None
    token: str = ''
    id: str = ''


def read_command(text: str) -> Command:
    """Return the command in a page's message; raise `CommandError` if it is invalid."""
    if len(text) > LONGEST_COMMAND:
        raise CommandError(f'a command must have at most {LONGEST_COMMAND} characters')
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        raise CommandError('a command must be JSON') from None
    if not isinstance(document, dict):
        raise CommandError('a command must be a JSON object')

    def text_of(key: str) -> str:
        value = document.get(key, '')
        if not isinstance(value, str) or len(value) > LONGEST_NAME or not value.isprintable():
            raise CommandError(
                f'{key} must be a printable string of at most {LONGEST_NAME} characters'
            )
        return value

    action = text_of('do')
    if action not in ACTIONS:
        raise CommandError(f'"{action}" is not a command; use {", ".join(ACTIONS)}')
    trial = None
    if action == 'trial':
        try:
            trial = TrialRequest(
                text_of('protocol'),
                text_of('contact'),
                text_of('object'),
                trial_id='',
                session_id=text_of('session'),
            )
        except ProtocolError as error:
            raise CommandError(str(error)) from error
    return Command(action, text_of('finger'), trial, text_of('token'), text_of('id'))


@dataclass(frozen=True)
class Access:
    """The access rules of a server.

    ``name`` is the name of the computer. In the address of the page, the host may be this name, an
    IP address or ``localhost``.
    """

    port: int
    name: str
    token: str

    def refuse_request(self, host: str, origin: str | None, *, is_socket: bool) -> str | None:
        """Return why a request is refused, or None if it is accepted.

        Other names in the header ``Host`` are refused, because DNS rebinding uses them. Other
        pages are refused by the header ``Origin``, which browsers send with every WebSocket.
        """
        if not self._is_ours(host):
            return 'this host name is not served; open the address that the command printed'
        if origin is None:
            return 'a WebSocket request needs the header Origin' if is_socket else None
        if origin != f'http://{host}':
            return 'requests from other pages are refused'
        return None

    def _is_ours(self, host: str) -> bool:
        try:
            parts = urlsplit(f'//{host}')
            name, port = parts.hostname or '', parts.port
        except ValueError:
            return False
        if (port or 80) != self.port or '@' in host or '/' in host:
            return False
        if name in ('localhost', self.name.lower()):
            return bool(name)
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True

    def refuse_command(self, command: Command) -> str | None:
        """Return why a command is refused, or None if it is accepted.

        The action ``stop`` needs no token, so that everyone who sees the page can stop the rig.
        """
        if command.action == 'stop' or self.is_token(command.token):
            return None
        return 'this page can only show and stop; open the full address that the command printed'

    def is_token(self, text: str) -> bool:
        """Return True if a text is the token. The comparison takes constant time."""
        return secrets.compare_digest(text.encode(), self.token.encode())
