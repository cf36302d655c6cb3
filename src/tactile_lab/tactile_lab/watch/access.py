# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Access rules of the live page and of commands that move the rig; free of any server."""

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
"""Actions that are for the whole rig, and name no finger."""

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
"""Headers of every answer: nothing is loaded from elsewhere, no other page shows this one."""


@dataclass(frozen=True)
class WatchOptions:
    """Address and port to listen on, and the token that moving needs.

    Port 0 takes the usual one, or any that is free. Servers that follow each other with the same
    options share the token.
    """

    host: str = '127.0.0.1'
    port: int = 0
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16))


class CommandError(TactileError):
    """A page sent what is no command; the message says why."""


@dataclass(frozen=True)
class Command:
    """Command from a page: one of `ACTIONS`, for a finger by its namespace.

    Those of `OF_ALL_FINGERS` are for all of them. The page knows the token from its address. The
    sentence about the command's end has its ``id``.
    """

    action: str
    finger: str = ''
    trial: TrialRequest | None = None
    token: str = ''
    id: str = ''


def read_command(text: str) -> Command:
    """Return the command in a page's message, or raise `CommandError`."""
    if len(text) > LONGEST_COMMAND:
        raise CommandError(f'a command has at most {LONGEST_COMMAND} characters')
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        raise CommandError('a command must be JSON') from None
    if not isinstance(document, dict):
        raise CommandError('a command must be a JSON object')

    def text_of(key: str) -> str:
        value = document.get(key, '')
        if not isinstance(value, str) or len(value) > LONGEST_NAME or not value.isprintable():
            raise CommandError(f'{key} must be a string of at most {LONGEST_NAME} letters')
        return value

    action = text_of('do')
    if action not in ACTIONS:
        raise CommandError(f'"{action}" is no command; there are {", ".join(ACTIONS)}')
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
    """The rules of a server on a port.

    Pages may be addressed to the computer's name, to addresses and to ``localhost``.
    """

    port: int
    name: str
    token: str

    def refuse_request(self, host: str, origin: str | None, *, is_socket: bool) -> str:
        """Return why a request is refused; empty when it is not.

        A foreign name in ``Host`` is what DNS rebinding needs, and an address cannot be rebound.
        Browsers send the ``Origin`` of the page with every WebSocket.
        """
        if not self._is_ours(host):
            return 'this host name is not served; open the address that the command has printed'
        if origin is None:
            return 'a socket needs an Origin' if is_socket else ''
        if origin != f'http://{host}':
            return 'requests of other pages are refused'
        return ''

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

    def refuse_command(self, command: Command) -> str:
        """Return why a command is refused; empty when it is not.

        A stop needs no token: whoever can see that something goes wrong must be able to stop it.
        """
        if command.action == 'stop' or self.is_token(command.token):
            return ''
        return 'this page may look and stop only; open the full address that the command printed'

    def is_token(self, text: str) -> bool:
        """Return whether a text is the token, in constant time."""
        return secrets.compare_digest(text.encode(), self.token.encode())
