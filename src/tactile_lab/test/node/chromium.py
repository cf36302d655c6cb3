# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A headless Chromium, which a script or a test controls with the DevTools protocol."""

from __future__ import annotations

import asyncio
import base64
import itertools
from pathlib import Path
import shutil
import subprocess
import tempfile
import time
from typing import Any

import aiohttp

NAMES = ('chromium', 'chromium-browser', 'google-chrome')
START_S = 60.0
ANSWER_S = 30.0


def find_chromium() -> str | None:
    """Return the path of Chromium; None if it is not installed."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Chromium:
    """A browser with one tab. It is a context manager; its methods block.

    Attributes
    ----------
    console : list of str
        Messages in the console of the page, including errors of the browser.
    """

    def __init__(self, width: int = 1280, height: int = 900) -> None:
        program = find_chromium()
        if program is None:
            raise FileNotFoundError(f'no {" or ".join(NAMES)} is installed')
        self.console: list[str] = []
        self._size = (width, height)
        self._folder = tempfile.TemporaryDirectory(prefix='chromium_', ignore_cleanup_errors=True)
        self._numbers = itertools.count(1)
        self._answers: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._loop = asyncio.new_event_loop()
        self._process = subprocess.Popen(
            [
                program,
                '--headless=new',
                '--no-sandbox',  # only the live page is opened, and containers have no namespaces
                '--disable-gpu',
                '--disable-dev-shm-usage',
                '--no-first-run',
                *('--disable-background-networking', '--disable-component-update'),
                *('--disable-sync', '--disable-quic'),
                '--hide-scrollbars',
                f'--user-data-dir={self._folder.name}',
                '--remote-debugging-port=0',
                'about:blank',
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def __enter__(self) -> Chromium:
        try:
            self._run(self._connect())
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._run(self._disconnect())
        self._end()

    def _end(self) -> None:
        self._process.kill()
        self._process.wait()
        self._loop.close()
        self._folder.cleanup()

    # -- use ------------------------------------------------------------------------

    def open(self, address: str) -> None:
        """Open a page, and wait until it has been loaded."""
        # A change of only the fragment would not reload the page.
        for url in ('about:blank', address):
            self.call('Page.navigate', url=url)
            self.wait_for(
                f'document.readyState === "complete" && location.href.startsWith({url!r})'
            )

    def evaluate(self, expression: str) -> Any:
        """Evaluate a JavaScript expression, and return its value."""
        answer = self.call(
            'Runtime.evaluate', expression=expression, returnByValue=True, awaitPromise=True
        )
        if 'exceptionDetails' in answer:
            raise RuntimeError(answer['exceptionDetails'].get('exception', {}).get('description'))
        return answer['result'].get('value')

    def wait_for(self, expression: str, timeout_s: float = ANSWER_S) -> None:
        """Wait until a JavaScript expression is true."""
        deadline = time.monotonic() + timeout_s
        while not self.evaluate(f'Boolean({expression})'):
            if time.monotonic() > deadline:
                text = self.evaluate('document.body.innerText')
                raise TimeoutError(f'never true: {expression}; the page says:\n{text}')
            time.sleep(0.05)

    def resize(self, width: int, height: int, scale: float = 1.0) -> None:
        """Set the size of the page [px]."""
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=width < 600,
        )

    def set_scheme(self, scheme: str) -> None:
        """Set the colour scheme of the page: ``light`` or ``dark``."""
        features = [{'name': 'prefers-color-scheme', 'value': scheme}]
        self.call('Emulation.setEmulatedMedia', features=features)

    def screenshot(self) -> bytes:
        """Return a screenshot as PNG."""
        data: str = self.call('Page.captureScreenshot', format='png')['data']
        return base64.b64decode(data)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the DevTools protocol, and return its result."""
        return self._run(self._call(method, parameters))

    # -- the protocol ------------------------------------------------------------------

    def _run(self, work: Any) -> Any:
        return self._loop.run_until_complete(work)

    async def _connect(self) -> None:
        port_file = Path(self._folder.name, 'DevToolsActivePort')
        deadline = time.monotonic() + START_S
        while not (port_file.exists() and port_file.read_text().strip()):
            if time.monotonic() > deadline or self._process.poll() is not None:
                raise TimeoutError('Chromium does not start')
            await asyncio.sleep(0.05)
        port = port_file.read_text().split()[0]
        self._session = aiohttp.ClientSession()
        async with self._session.get(f'http://127.0.0.1:{port}/json/list') as answer:
            tabs = await answer.json()
        url = next(tab['webSocketDebuggerUrl'] for tab in tabs if tab['type'] == 'page')
        self._socket = await self._session.ws_connect(url, max_msg_size=0)
        self._reader = asyncio.create_task(self._read())
        for domain in ('Page', 'Runtime', 'Log', 'Network'):
            await self._call(f'{domain}.enable', {})
        width, height = self._size
        await self._call(
            'Emulation.setDeviceMetricsOverride',
            {'width': width, 'height': height, 'deviceScaleFactor': 1, 'mobile': False},
        )

    async def _disconnect(self) -> None:
        self._reader.cancel()
        await self._socket.close()
        await self._session.close()

    async def _call(self, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        number = next(self._numbers)
        self._answers[number] = self._loop.create_future()
        await self._socket.send_json({'id': number, 'method': method, 'params': parameters})
        try:
            answer = await asyncio.wait_for(self._answers[number], ANSWER_S)
        finally:
            del self._answers[number]
        if 'error' in answer:
            raise RuntimeError(f'{method}: {answer["error"]["message"]}')
        return answer.get('result', {})

    async def _read(self) -> None:
        async for message in self._socket:
            document = message.json()
            if (number := document.get('id')) in self._answers:
                self._answers[number].set_result(document)
            elif document.get('method') == 'Runtime.consoleAPICalled':
                values = [str(a.get('value', a)) for a in document['params']['args']]
                self.console.append(' '.join(values))
            elif document.get('method') == 'Runtime.exceptionThrown':
                details = document['params']['exceptionDetails']
                self.console.append(str(details.get('exception', {}).get('description', details)))
            elif document.get('method') == 'Log.entryAdded':
                entry = document['params']['entry']
                self.console.append(f'{entry["text"]} {entry.get("url", "")}')
