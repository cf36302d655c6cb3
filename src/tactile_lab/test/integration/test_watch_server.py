# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The server of the live page, over real HTTP and WebSockets."""

import asyncio
import contextlib
import json
from pathlib import Path
import socket
import time

import aiohttp
import numpy as np
import pytest

from tactile_lab.watch import server as server_module
from tactile_lab.watch.access import WatchOptions
from tactile_lab.watch.finger import Finger
from tactile_lab.watch.server import (
    FILES,
    FRAMES_HZ,
    MOST_PAGES,
    MOST_WAITING,
    WatchServer,
)
from tactile_lab.watch.state import WatchState
from tactile_ros.errors import TactileError
from tactile_ros.strain import StrainBlock
from tactile_testing.waiting import wait_until

DEADLINE_S = 10.0
TRIAL = {'do': 'trial', 'protocol': 'texture', 'contact': 'flexion', 'object': 'R1'}


class Controls:
    """Replaces `WatchControls`, and stores the requests."""

    def __init__(self):
        self.calls = []

    async def stop(self):
        self.calls.append('stop')
        return 'stopped'

    async def tare(self, finger):
        self.calls.append(f'tare {finger}')
        raise TactileError('tare: the finger is loaded')

    async def home(self, finger):
        self.calls.append(f'home {finger}')
        return 'homed'

    async def trial(self, finger, request):
        self.calls.append(f'trial {finger} {request.protocol} {request.object_label}')
        raise RuntimeError('a fault of the program')


@pytest.fixture
def state():
    return WatchState()


@pytest.fixture
def controls():
    return Controls()


@pytest.fixture
def server(state, controls):
    with WatchServer(state, controls) as server:
        yield server


def token_of(server):
    return server.address.split('#')[1]


def run(work):
    return asyncio.run(asyncio.wait_for(work, 6 * DEADLINE_S))


@contextlib.asynccontextmanager
async def page(server, origin=None, host=None, token=''):
    """Open a WebSocket as a page does."""
    own = f'127.0.0.1:{server.port}'
    headers = {'Origin': origin or f'http://{own}', 'Host': host or own}
    protocols = ['tactile', token] if token else []
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f'http://{own}/live', headers=headers, protocols=protocols) as socket,
    ):
        yield socket


async def until(socket, condition):
    """Receive frames until one meets a condition, and return it."""
    while True:
        frame = json.loads(await asyncio.wait_for(socket.receive_str(), DEADLINE_S))
        if condition(frame):
            return frame


def sentences(frame):
    return [s['text'] for s in frame.get('state', {}).get('said', [])]


def block(number, count=1, rate_hz=60.0):
    period_ns = round(1e9 / rate_hz)
    return StrainBlock(10**18 + number * period_ns, number, period_ns, np.full(count, 1.0))


def get(server, path='/', **headers):
    """Return status, headers and text of a response."""

    async def work():
        async with (
            aiohttp.ClientSession() as session,
            session.get(f'http://127.0.0.1:{server.port}{path}', headers=headers) as answer,
        ):
            return answer.status, answer.headers, await answer.text()

    return run(work())


def test_only_the_files_of_the_page_are_served_with_security_headers(server):
    for path in FILES:
        status, headers, text = get(server, path)
        assert (status, bool(text.strip())) == (200, True), path
        policy = headers['Content-Security-Policy']
        assert "default-src 'none'" in policy
        assert 'unsafe' not in policy
        assert "frame-ancestors 'none'" in policy
        assert headers['X-Content-Type-Options'] == 'nosniff'
        assert 'Access-Control-Allow-Origin' not in headers
    for path in ('/page.py', '/../server.py', '/%2e%2e/server.py', '/page/'):
        assert get(server, path)[0] == 404, path


def test_foreign_host_names_get_neither_page_nor_socket(server):
    status, _, text = get(server, Host='evil.example')
    assert status == 403
    assert 'this host name is not served' in text

    async def work():
        async with page(server, 'http://rebound.example:8642', 'rebound.example:8642'):
            pass

    with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
        run(work())
    assert refused.value.status == 403


def test_without_the_token_a_page_can_only_stop(controls, server):
    async def work():
        async with page(server) as socket:
            await socket.send_json({'do': 'home', 'finger': 'index'})
            await until(socket, lambda f: any('only show and stop' in s for s in sentences(f)))
            await socket.send_json({'do': 'stop'})
            await until(socket, lambda f: 'stopped' in sentences(f))
            await socket.send_json({'do': 'home', 'finger': 'index', 'token': token_of(server)})
            await until(socket, lambda f: 'homed' in sentences(f))

    run(work())
    assert controls.calls == ['stop', 'home index']


def test_failed_and_invalid_commands_are_reported_to_all_pages(controls, server):
    token = token_of(server)

    async def work():
        async with page(server) as one, page(server) as other:
            for number, (command, said) in enumerate(
                (
                    ({'do': 'tare', 'token': token}, 'tare: the finger is loaded'),
                    ({**TRIAL, 'token': token}, 'a fault of the program'),
                    ({'do': 'trial', 'token': token}, 'protocol is ""'),
                    ({'do': 'home'}, 'only show and stop'),
                    ({'do': 'dance'}, '"dance" is not a command'),
                    ({'do': 'stop'}, 'stopped'),
                )
            ):
                await one.send_json({**command, 'id': f'{number}'})
                for socket in (one, other):
                    frame = await until(
                        socket, lambda f, said=said: any(said in s for s in sentences(f))
                    )
                    last = frame['state']['said'][-1]
                    if number not in (2, 3, 4):  # an unreadable command has no id
                        assert last['id'] == f'{number}'
                    assert last['level'] == ('ok' if said == 'stopped' else 'error')

    run(work())
    assert controls.calls == ['tare ', 'trial  texture R1', 'stop']


def test_frames_are_only_made_for_open_pages_at_a_limited_rate(state, server, monkeypatch):
    frames, send = [], server._send_to_all

    def count(frame, **options):
        frames.append(frame)
        send(frame, **options)

    monkeypatch.setattr(server, '_send_to_all', count)
    state.update('', Finger.take_block, block(0))
    assert not frames

    async def work():
        async with page(server) as one, page(server) as other:
            begun = time.monotonic()
            for number in range(1, 2001):
                state.update('', Finger.take_block, block(number, rate_hz=1000.0))
                if number % 20 == 0:
                    await asyncio.sleep(0.01)  # the frame rate is tested
            for socket in (one, other):
                await until(socket, lambda f: (f.get('live', {}).get('') or {}).get('y'))
            return time.monotonic() - begun

    seconds = run(work())
    assert 2 <= len(frames) <= FRAMES_HZ * seconds + 5
    wait_until(lambda: not server._pages)
    made = len(frames)
    state.update('', Finger.take_block, block(3000, rate_hz=1000.0))
    assert server._pages == set()
    assert len(frames) == made


def test_late_or_reconnected_page_gets_each_point_once(state, server):
    for number in range(100):
        state.update('', Finger.take_block, block(number))

    async def work():
        async with page(server) as one:
            first = await until(one, lambda f: f.get('live'))
            async with page(server) as other:
                second = await until(other, lambda f: f.get('live'))
        async with page(server) as socket:  # the page connects again immediately
            frame = await until(socket, lambda f: f.get('begin'))
            times = frame['live']['']['x']
            for number in range(100, 130):
                state.update('', Finger.take_block, block(number))
                frame = await until(socket, lambda f: f.get('live'))
                times += frame['live']['']['x']
        return first, second, times

    *frames, times = run(work())
    for frame in frames:
        assert frame['begin']
        assert len(frame['live']['']['y']) == 100
    assert times == sorted(set(times))
    assert len(times) == 130


def test_number_of_pages_is_limited_and_the_last_one_needs_the_token(server):
    async def work():
        async with contextlib.AsyncExitStack() as stack:

            async def enter(token=''):
                socket = await stack.enter_async_context(page(server, token=token))
                await until(socket, lambda f: True)
                return socket

            async def is_refused(token=''):
                with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                    await enter(token)
                return refused.value.status == 503

            token = token_of(server)
            for _ in range(MOST_PAGES - 1):
                await enter()
            assert await is_refused()
            assert await is_refused(token[:-1])
            last = await enter(token)
            assert last.protocol == 'tactile'
            assert await is_refused(token)

    run(work())


def open_connections(server, count, text=b''):
    """Open connections that send a text and then nothing."""
    connections = [socket.create_connection(('127.0.0.1', server.port)) for _ in range(count)]
    for connection in connections:
        connection.sendall(text)
    return connections


def is_closed(connection):
    connection.setblocking(False)
    try:
        return connection.recv(1) == b''
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


@pytest.mark.parametrize('text', [b'', b'GET / HTTP/1.1\r\nHost: '])
def test_silent_connections_are_limited_and_closed_without_blocking_pages(
    server, monkeypatch, text
):
    async def work():
        async with page(server) as socket:
            await until(socket, lambda f: f.get('begin'))
            connections = open_connections(server, 3 * MOST_WAITING, text)
            await asyncio.to_thread(
                wait_until, lambda: sum(map(is_closed, connections)) >= 2 * MOST_WAITING
            )
            assert len(list(Path('/proc/self/fd').iterdir())) < before + 5 * MOST_WAITING
            for connection in connections:
                connection.close()
            monkeypatch.setattr(server_module, 'WAITING_S', 0.2)
            (connection,) = open_connections(server, 1, text)
            await asyncio.to_thread(wait_until, lambda: is_closed(connection))
            await until(socket, lambda f: f == {})  # the open page stays open
            connection.close()

    # Connections are now only closed because of their number.
    monkeypatch.setattr(server_module, 'WAITING_S', 1e3)
    before = len(list(Path('/proc/self/fd').iterdir()))
    run(work())
    assert get(server)[0] == 200


def test_second_server_selects_another_port_and_a_requested_port_in_use_is_refused(server):
    with WatchServer(WatchState(), Controls()) as second:
        assert second.port != server.port
        assert token_of(second) != token_of(server)
    with pytest.raises(TactileError, match=f'port {server.port}.*choose another --port'):
        WatchServer(WatchState(), Controls(), WatchOptions(port=server.port))


def test_the_end_of_the_server_closes_its_pages():
    async def work():
        with WatchServer(WatchState(), Controls()) as server:
            async with page(server) as socket:
                await until(socket, lambda f: True)
                await asyncio.to_thread(server.close)
                while (message := await socket.receive()).type == aiohttp.WSMsgType.TEXT:
                    pass
                return message.type

    assert run(work()) in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
