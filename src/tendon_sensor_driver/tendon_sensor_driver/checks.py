# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Check of a user's own `SensorClient`, for use in tests."""

from __future__ import annotations

from collections.abc import Callable
import threading
import time

import numpy as np

from tactile_ros.strain import NO_MEASUREMENT, StrainBlock, StrainStatus
from tendon_sensor_driver.client import NowNs, OnBlock, SensorClient
from tendon_sensor_driver.errors import TendonSensorError

MakeSensor = Callable[[OnBlock, NowNs], SensorClient]

_STEP_S = 0.005
_FAULT = 'the consumer of check_sensor fails once'


class SensorCheckError(TendonSensorError):
    """A client does not behave as `SensorClient` requires.

    Attributes
    ----------
    code : str
        The check that failed: ``health``, ``open``, ``silent``, ``block``, ``order``,
        ``consumer`` or ``close``.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code


def check_sensor(make: MakeSensor, blocks: int = 10, timeout_s: float = 20.0) -> None:
    """Check that a client behaves as `SensorClient` requires.

    The check opens the client, whose sensor must send samples, lets the consumer of the blocks
    fail once, and closes the client. It verifies the blocks, that sequence numbers and stamps
    increase, the result of `health`, and that a client can be opened only once. It does not verify
    the values of the tension.

    Parameters
    ----------
    make : callable
        ``make(on_block, now_ns)`` returns a client that is not opened yet.
    blocks : int
        Number of blocks to wait for, before and after the failure of the consumer.
    timeout_s : float
        Longest time to wait for these blocks [s].

    Raises
    ------
    SensorCheckError
        If a check fails; ``code`` names the check.
    """
    heard: list[StrainBlock] = []
    should_fail = threading.Event()
    threads: set[int] = set()

    def on_block(block: StrainBlock) -> None:
        threads.add(threading.get_ident())
        heard.append(block)
        if should_fail.is_set():
            should_fail.clear()
            raise RuntimeError(_FAULT)

    client = make(on_block, time.time_ns)
    _require(not client.health().is_connected, 'health', 'is_connected is true before open()')
    with client:
        _check_is_refused(client, 'a client that is open')
        _wait_for(heard, blocks, timeout_s, 'silent', client)
        health = client.health()
        _require(
            health.is_connected and health.readings > 0,
            'health',
            f'while samples arrive, is_connected is {health.is_connected} and readings is '
            f'{health.readings}',
        )
        should_fail.set()
        _wait_for(heard, len(heard) + blocks, timeout_s, 'consumer', client)
        error = client.health().last_error or ''
        _require(
            not should_fail.is_set() and _FAULT in error,
            'consumer',
            f'an exception of the consumer must be caught and stored in last_error, which is '
            f'"{error}"',
        )
    delivered = len(heard)
    client.close()
    _require(not client.health().is_connected, 'close', 'is_connected is true after close()')
    _check_is_refused(client, 'a client that was closed')
    _require(
        threading.get_ident() not in threads or len(threads) > 1,
        'open',
        'on_block is called on the thread that opened the client; read on a separate thread',
    )
    _check_blocks(heard)
    time.sleep(10 * _STEP_S)
    _require(len(heard) == delivered, 'close', 'on_block is called after close()')


def _require(is_kept: bool, code: str, message: str) -> None:
    if not is_kept:
        raise SensorCheckError(code, message)


def _check_is_refused(client: SensorClient, what: str) -> None:
    try:
        client.open()
    except TendonSensorError:
        return
    raise SensorCheckError('open', f'open() of {what} must raise TendonSensorError')


def _wait_for(
    heard: list[StrainBlock], count: int, timeout_s: float, code: str, client: SensorClient
) -> None:
    deadline_s = time.monotonic() + timeout_s
    while len(heard) < count:
        if time.monotonic() > deadline_s:
            message = f'{len(heard)} of {count} blocks arrived within {timeout_s:g} s'
            raise SensorCheckError(code, f'{message}; last_error: "{client.health().last_error}"')
        time.sleep(_STEP_S)


def _check_blocks(heard: list[StrainBlock]) -> None:
    now_ns = time.time_ns()
    before = None
    for block in heard:
        count = len(block.tension_n)
        is_whole = (
            block.tension_n.dtype == np.float64
            and block.tension_n.ndim == 1
            and count > 0
            and block.period_ns > 0
            and (block.wrench is None or block.wrench.shape == (count, 6))
        )
        _require(
            is_whole,
            'block',
            f'a block needs float64 samples, a positive period and six axes or none: {block}',
        )
        is_marked = bool(block.status & NO_MEASUREMENT)
        _require(
            is_marked or bool(np.isfinite(block.tension_n).all()),
            'block',
            f'values that are not finite need a status such as DEVICE_ERROR: {block}',
        )
        _require(
            abs(block.stamp_ns - now_ns) < 3600e9,
            'block',
            f'the stamp {block.stamp_ns} ns is far from the time of now_ns(), {now_ns} ns',
        )
        if before is not None:
            _check_follows(before, block)
        before = block


def _check_follows(before: StrainBlock, block: StrainBlock) -> None:
    count = len(before.tension_n)
    expected = before.sequence + count + block.lost_before
    _require(
        block.sequence == expected or bool(block.status & StrainStatus.RECONNECTED),
        'order',
        f'the block after number {before.sequence} with {count} samples has number '
        f'{block.sequence} and lost_before {block.lost_before}; it must be {expected}',
    )
    last_ns = before.stamp_ns + (count - 1) * before.period_ns
    _require(
        block.stamp_ns > last_ns or bool(block.status & StrainStatus.CLOCK_STEP),
        'order',
        f'the stamp {block.stamp_ns} ns is not later than the sample before, {last_ns} ns',
    )
