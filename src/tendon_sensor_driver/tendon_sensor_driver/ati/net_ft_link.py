# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The records of a Net F/T, in whole arrays, from a socket that is emptied at once."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import select
import socket
import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendon_sensor_driver.ati.net_ft_protocol import (
    classify_status,
    Command,
    decode_records,
    describe_status,
    encode_request,
    MOST_RECORDS,
    RECORD_BYTES,
)
from tendon_sensor_driver.ati.net_ft_web import BoxConfiguration
from tendon_sensor_driver.errors import LinkError
from tendon_sensor_driver.records import AXES, TendonSensorConfig
from tendon_sensor_driver.stream.clock import Batch

_WAIT_S = 0.1
_LONGEST_WAIT_S = 0.25
_DEAD_S = 0.6
_PERIODS = 6  # without a record, after which one is missing
_LONGEST_GATHER_S = 0.02
_MOST_DATAGRAMS = 4096  # in one batch
_BUFFER_BYTES = 4 << 20


class LinkCounts(NamedTuple):
    """Bytes and datagrams that a link has received, and those of them that were no records."""

    bytes: int = 0
    datagrams: int = 0
    rejected: int = 0

    def plus(self, other: LinkCounts) -> LinkCounts:
        """Return the sums."""
        return LinkCounts(*(own + its for own, its in zip(self, other, strict=True)))


class NetFtLink:
    """A running stream of records.

    In buffered mode a datagram holds up to 40 records: then the kernel keeps some hundred
    milliseconds at 7000 Hz for a host that is busy elsewhere, and loses nothing.

    Parameters
    ----------
    config : TendonSensorConfig
    box : BoxConfiguration
        What the box says of itself.
    rate_hz : float
        Rate at which it sends [Hz].
    now_ns : callable
        The present host time [ns].

    Raises
    ------
    LinkError
        When there is no such host.
    """

    def __init__(
        self,
        config: TendonSensorConfig,
        box: BoxConfiguration,
        rate_hz: float,
        now_ns: Callable[[], int],
    ) -> None:
        self._host = config.host
        self._axis = AXES.index(config.axis)
        self._scale = config.scale
        self._is_axia = box.is_axia
        self._now_ns = now_ns
        self._gather_s = min((config.block_samples - 1) / rate_hz, _LONGEST_GATHER_S)
        self._missing_s = max(_WAIT_S, _PERIODS / rate_hz)
        self._dead_s = max(_DEAD_S, 2 * self._missing_s)
        self._wait_s = min(self._missing_s, _LONGEST_WAIT_S)
        self._heard_s = self._asked_s = time.monotonic()
        self._status_word = box.status
        self._counts = LinkCounts()
        self._si_per_count = box.si_per_count
        self._start = (
            Command.START_BUFFERED
            if 1 < box.records_per_datagram <= MOST_RECORDS
            else Command.START_REALTIME
        )
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            # The kernel grants less than is asked for where its limit is lower.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            self._socket.setblocking(False)
            self._socket.connect((config.host, config.rdt_port))  # so that nobody else is heard
            self._socket.send(encode_request(Command.STOP))
            self._socket.send(encode_request(self._start))
        except OSError as error:
            self._socket.close()
            raise LinkError(f'cannot reach the Net F/T at {config.host}: {error}') from error

    @property
    def counts(self) -> LinkCounts:
        """Bytes, datagrams and rejected datagrams received so far."""
        return self._counts

    def describe_status(self) -> str:
        """Return what the newest record says is wrong with the box; empty when nothing is."""
        return ', '.join(describe_status(self._status_word, is_axia=self._is_axia))

    def read(self) -> Batch | None:
        """Return what has arrived, or None after a quarter of a second without any.

        Raises
        ------
        LinkError
            When no records come any more.
        """
        try:
            if not select.select([self._socket], [], [], self._wait_s)[0]:
                if self._check_silence():  # the request may have been lost
                    self._socket.send(encode_request(self._start))
                return None
            received_at_ns = self._now_ns()
            if self._gather_s:
                time.sleep(self._gather_s)
            datagrams = self._take_waiting()
        except OSError as error:
            raise LinkError(f'lost the Net F/T at {self._host}: {error}') from error
        good = [datagram for datagram in datagrams if _is_whole(datagram)]
        self._counts = self._counts.plus(
            LinkCounts(
                bytes=sum(map(len, datagrams)),
                datagrams=len(datagrams),
                rejected=len(datagrams) - len(good),
            )
        )
        if not good:
            self._check_silence()
            return None
        return self._decode(good, received_at_ns)

    def close(self) -> None:
        """Ask the box to stop, and let go of it."""
        with contextlib.suppress(OSError):
            self._socket.send(encode_request(Command.STOP))
        self._socket.close()

    def _take_waiting(self) -> list[bytes]:
        datagrams: list[bytes] = []
        with contextlib.suppress(BlockingIOError):
            while len(datagrams) < _MOST_DATAGRAMS:
                datagrams.append(self._socket.recv(65536))
        return datagrams

    def _decode(self, datagrams: list[bytes], received_at_ns: int) -> Batch:
        """Note that records came; return them as a batch."""
        records: NDArray[np.void] = decode_records(b''.join(datagrams))
        words = records['status'].astype(np.uint32)
        self._heard_s = self._asked_s = time.monotonic()
        self._status_word = int(words[-1])
        wrench = records['counts'] * self._si_per_count
        return Batch(
            received_at_ns=received_at_ns,
            tension_n=self._scale * wrench[:, self._axis],
            ticks=records['ft_sequence'].astype(np.uint32),
            wrench=wrench,
            status=classify_status(words, is_axia=self._is_axia),
            # A datagram is sent as soon as its last record is there.
            timed=len(datagrams[0]) // RECORD_BYTES - 1,
            records=records['rdt_sequence'].astype(np.uint32),
        )

    def _check_silence(self) -> bool:
        """Return whether to request the stream again.

        Raises
        ------
        LinkError
            When no records have come despite repeated requests.
        """
        now_s = time.monotonic()
        if now_s - self._heard_s > self._dead_s:
            raise LinkError(
                f'no records from the Net F/T at {self._host} for {now_s - self._heard_s:.1f} s; '
                'check its power and cable, and that no other program has started its stream'
            )
        if now_s - self._asked_s < self._missing_s:
            return False
        self._asked_s = now_s
        return True


def _is_whole(datagram: bytes) -> bool:
    return 0 < len(datagram) <= MOST_RECORDS * RECORD_BYTES and not len(datagram) % RECORD_BYTES
