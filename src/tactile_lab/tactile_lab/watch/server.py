# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Web server of the live page, with a WebSocket for frames and commands. Without ROS."""

from __future__ import annotations

import asyncio
import errno
from functools import partial
import json
from pathlib import Path
import socket
import threading
from typing import Any, TYPE_CHECKING

from aiohttp import web, WSMsgType

from tactile_lab.watch.access import (
    Access,
    Command,
    HEADERS,
    LONGEST_COMMAND,
    OF_ALL_FINGERS,
    read_command,
    WatchOptions,
)
from tactile_lab.watch.state import Frames, WatchState
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_lab.watch.controls import WatchControls

PAGE = Path(__file__).parent / 'page'
FILES = {
    '/': ('index.html', 'text/html'),
    '/page.css': ('page.css', 'text/css'),
    '/page.js': ('page.js', 'text/javascript'),
    '/plots.js': ('plots.js', 'text/javascript'),
    '/uPlot.iife.min.js': ('uPlot.iife.min.js', 'text/javascript'),
    '/uPlot.min.css': ('uPlot.min.css', 'text/css'),
}

PORT = 8642
"""Default port. If it is in use, any free port is used."""

FRAMES_HZ = 20.0
"""Number of frames per second for pages; it does not depend on the rate of the sensor."""

IDLE_FRAME_S = 0.5
"""Longest time between frames [s]. A page that receives no frame for much longer shows that it is
not connected."""

MOST_PAGES = 16
"""Largest number of open pages. The last one must have the token."""

PROTOCOL = 'tactile'
"""Subprotocol of the WebSocket. A page that has the token offers it as a second subprotocol."""

MOST_WAITING = 64
WAITING_S = 10.0
"""Connections without an open WebSocket: at most `MOST_WAITING` are kept, each for at most
`WAITING_S` [s]. A new connection beyond this number closes the oldest one."""

SEND_TIMEOUT_S = 5.0
START_TIMEOUT_S = 10.0


class WatchServer:
    """A web server in a thread. It is a context manager.

    ``address`` is the address of the page, including the token. Raises `TactileError` when the
    port cannot be opened.
    """

    def __init__(
        self, state: WatchState, controls: WatchControls, options: WatchOptions | None = None
    ) -> None:
        options = options or WatchOptions()
        host = options.host
        self._state = state
        self._controls = controls
        self._sockets = _listen(host, options.port)
        self.port = int(self._sockets.getsockname()[1])
        self._access = Access(self.port, socket.gethostname(), options.token)
        is_everywhere = host in ('0.0.0.0', '::', '')  # noqa: S104 - requested by the user
        shown = socket.gethostname() if is_everywhere else f'[{host}]' if ':' in host else host
        self.address = f'http://{shown}:{self.port}/#{self._access.token}'
        self._pages: set[_Page] = set()
        self._waiting: dict[web.RequestHandler, asyncio.TimerHandle] = {}  # oldest first
        self._tasks: set[asyncio.Task[Any]] = set()
        self._sending: asyncio.Task[Any] | None = None
        self._loop = asyncio.new_event_loop()
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._serve, name='watch server', daemon=True)

    def __enter__(self) -> WatchServer:
        self._thread.start()
        self._started.wait(START_TIMEOUT_S)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop the server. May be called repeatedly."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._ending.set)
            self._thread.join(START_TIMEOUT_S)

    def _serve(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._ending = asyncio.Event()
        try:
            self._loop.run_until_complete(self._run())
        finally:
            self._loop.close()

    async def _run(self) -> None:
        app = web.Application(client_max_size=LONGEST_COMMAND, middlewares=[self._guard])
        app.router.add_get('/live', self._handle_page)
        for path in FILES:
            app.router.add_get(path, self._handle_file)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        assert runner.server is not None
        listener = await self._loop.create_server(
            partial(self._connect, runner.server), sock=self._sockets
        )
        self._started.set()
        await self._ending.wait()
        listener.close()
        for page in list(self._pages):
            await page.socket.close(code=1001, message=b'the program has ended')
        await runner.cleanup()

    # -- connections -------------------------------------------------------------------

    def _connect(self, server: web.Server) -> web.RequestHandler:
        """Return the handler of a new connection.

        The connection is closed after `WAITING_S`, unless it opens the WebSocket of a page.
        """
        if len(self._waiting) >= MOST_WAITING:
            self._cut(next(iter(self._waiting)))
        handler = server()
        self._waiting[handler] = self._loop.call_later(WAITING_S, self._cut, handler)
        return handler

    def _cut(self, handler: web.RequestHandler) -> None:
        self._waiting.pop(handler).cancel()

        def abort() -> None:
            if handler.transport is not None:
                handler.transport.abort()

        self._loop.call_soon(abort)  # deferred, because a new connection may have no transport yet

    # -- requests ----------------------------------------------------------------------

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        refusal = self._access.refuse_request(
            request.headers.get('Host', ''),
            request.headers.get('Origin'),
            is_socket=request.path == '/live',
        )
        if refusal:
            return web.Response(status=403, text=f'{refusal}\n', headers=HEADERS)
        try:
            response: web.StreamResponse = await handler(request)
        except web.HTTPException as error:
            return web.Response(status=error.status, text=f'{error.reason}\n', headers=HEADERS)
        return response

    async def _handle_file(self, request: web.Request) -> web.Response:
        name, content_type = FILES[request.path]
        body = (PAGE / name).read_bytes()
        return web.Response(body=body, content_type=content_type, charset='utf-8', headers=HEADERS)

    async def _handle_page(self, request: web.Request) -> web.StreamResponse:
        offered = request.headers.get('Sec-WebSocket-Protocol', '').split(',')
        has_token = any(self._access.is_token(name.strip()) for name in offered)
        if len(self._pages) >= MOST_PAGES - (not has_token):
            raise web.HTTPServiceUnavailable(
                reason=f'{len(self._pages)} pages are open; close one'
            )
        page, transport = _Page(), request.transport
        await page.socket.prepare(request)
        self._pages.add(page)
        if timer := self._waiting.pop(request.protocol, None):
            timer.cancel()
        if self._sending is None or self._sending.done():
            self._sending = self._keep(self._send_frames())
        try:
            async for message in page.socket:
                if message.type == WSMsgType.TEXT:
                    self._keep(self._obey(message.data))
        finally:
            self._pages.discard(page)
            if transport is not None:  # a browser that does not read would keep it open
                self._loop.call_later(WAITING_S, transport.abort)
        return page.socket

    # -- output -------------------------------------------------------------------------

    async def _send_frames(self) -> None:
        """Send frames while a page is open.

        After an error all pages are closed, so that they show that they are not connected.
        """
        frames = Frames(self._state)
        sent_s = self._loop.time()
        try:
            while self._pages:
                begins = any(page.needs_all and page.is_ready for page in self._pages)
                if begins:
                    frames.restart()
                frame = frames.next()
                if begins:
                    frame = {**(frame or {}), 'begin': True}
                if frame or self._loop.time() - sent_s >= IDLE_FRAME_S:
                    self._send_to_all(frame or {}, begin=begins)
                    sent_s = self._loop.time()
                await asyncio.sleep(1.0 / FRAMES_HZ)
        finally:
            while self._pages:  # while waiting, new pages may be opened
                await self._pages.pop().socket.close(code=1011)

    def _send_to_all(self, frame: dict[str, Any], *, begin: bool) -> None:
        """Send a frame to all pages that have received the previous one.

        The other pages get a complete frame later.
        """
        text = json.dumps(frame, separators=(',', ':'), allow_nan=False)
        for page in self._pages:
            if not page.is_ready:
                page.needs_all = True
            if not page.is_ready or (page.needs_all and not begin):
                continue
            page.needs_all = False
            page.sending = self._keep(page.send(text))

    # -- input ---------------------------------------------------------------------------

    async def _obey(self, text: str) -> None:
        command = None
        try:
            command = read_command(text)
            if refusal := self._access.refuse_command(command):
                raise TactileError(refusal)
            sentence, level = await self._carry_out(command), 'ok'
        except Exception as error:  # any error must be shown on the page
            sentence, level = str(error) or type(error).__name__, 'error'
        of_one = command is not None and command.action not in OF_ALL_FINGERS
        finger = command.finger if command and of_one else None
        self._state.say(sentence, level, command.id if command else '', finger)

    async def _carry_out(self, command: Command) -> str:
        controls, finger = self._controls, command.finger
        match command.action:
            case 'stop':
                return await controls.stop()
            case 'release':
                return await controls.release()
            case 'reset':
                return await controls.reset()
            case 'tare':
                return await controls.tare(finger)
            case 'home':
                return await controls.home(finger)
        assert command.trial is not None
        return await controls.trial(finger, command.trial)

    def _keep(self, work: Any) -> asyncio.Task[Any]:
        """Run a coroutine as a task, and keep a reference: the event loop has only a weak one."""
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task


class _Page:
    """One open page."""

    def __init__(self) -> None:
        self.socket = web.WebSocketResponse(
            heartbeat=5.0, max_msg_size=LONGEST_COMMAND, compress=False, protocols=(PROTOCOL,)
        )
        self.needs_all = True  # True if this client has no data yet, or has missed a frame
        self.sending: asyncio.Task[Any] | None = None

    @property
    def is_ready(self) -> bool:
        """True if the last frame has been sent completely."""
        return self.sending is None or self.sending.done()

    async def send(self, text: str) -> None:
        try:
            await asyncio.wait_for(self.socket.send_str(text), SEND_TIMEOUT_S)
        except (ConnectionError, asyncio.TimeoutError, RuntimeError):
            await self.socket.close()


def _listen(host: str, port: int) -> socket.socket:
    """Open and return a listening socket."""
    family = socket.AF_INET6 if ':' in host else socket.AF_INET
    try:
        return socket.create_server((host, port or PORT), family=family)
    except OSError as error:
        if port or error.errno != errno.EADDRINUSE:
            raise TactileError(
                f'cannot serve the live page on {host}, port {port or PORT}: {error.strerror}; '
                'choose another --port or --host'
            ) from error
    return socket.create_server((host, 0), family=family)
