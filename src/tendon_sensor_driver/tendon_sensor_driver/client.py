# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The serial port, and the base classes of the sensor clients."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
import errno
import logging
import os
import select
import termios
import threading
import time
from typing import Any, Generic, Protocol, TypeVar

import serial
from serial.tools import list_ports

from tactile_ros.strain import StrainBlock
from tendon_sensor_driver.clock import ArrivalClock
from tendon_sensor_driver.config import TendonSensorConfig
from tendon_sensor_driver.errors import LinkError, TendonSensorError
from tendon_sensor_driver.strain_stream import Stream
from tendon_sensor_driver.types import SensorHealth

_WRITE_TIMEOUT_S = 0.5
_MOST_BYTES = 4096

# Exceptions that pyserial raises when a device is unplugged.
_FAILURES = (OSError, termios.error, ValueError)

_REMEDIES = {
    errno.ENOENT: 'there is no such device; check the cable and the parameter "port"',
    errno.EACCES: 'no permission; add the user to the group that owns it (usually dialout)',
    errno.EAGAIN: 'another program has it open; close that program first',
    errno.EBUSY: 'another program has it open; close that program first',
}


class SerialTransport:
    """A serial port that is open from construction to `close`.

    Some boards reset when their port is opened.

    Parameters
    ----------
    port : str
        Name of the device, such as ``/dev/ttyUSB0``.
    baud : int
        Speed of the port [baud].

    Raises
    ------
    LinkError
        If the port cannot be opened. `read` and `write` raise it when the port is lost.
    """

    def __init__(self, port: str, baud: int) -> None:
        self._name = port
        try:
            # The access is exclusive, because two programs would each read a part of the bytes.
            self._port = serial.Serial(
                port, baud, timeout=0, write_timeout=_WRITE_TIMEOUT_S, exclusive=True
            )
        except _FAILURES as error:
            reason = _REMEDIES.get(getattr(error, 'errno', None) or 0, str(error))
            raise LinkError(f'cannot open serial port {port}: {reason}') from error
        self._number = self._port.fileno()
        waiting = select.poll()
        waiting.register(self._number, select.POLLIN)
        self._wait = waiting.poll

    def read(self, timeout_s: float) -> bytes:
        """Return the received bytes, or no bytes if none arrive within ``timeout_s`` [s]."""
        # This is faster than pyserial's read, as it waits and reads only once.
        if not self._wait(timeout_s * 1000):
            return b''
        try:
            data = os.read(self._number, _MOST_BYTES)
        except BlockingIOError:
            return b''
        except _FAILURES as error:
            raise LinkError(f'lost serial port {self._name}: {error}') from error
        if not data:
            raise LinkError(
                f'lost serial port {self._name}: it reports data to read but returns none'
            )
        return data

    def write(self, data: bytes) -> None:
        """Write bytes to the port."""
        try:
            self._port.write(data)
        except _FAILURES as error:
            raise LinkError(f'cannot write to serial port {self._name}: {error}') from error

    def close(self) -> None:
        """Close the port; idempotent. Must not be called while another thread is in `read`."""
        self._port.close()


def find_serial_number(port: str) -> str:
    """Return the serial number of a port's USB adapter, or an empty string if it has none."""
    device = os.path.realpath(port)
    try:
        ports = list_ports.comports()
    except (OSError, TypeError, ValueError):  # pyserial raises them while a device is unplugged
        return ''
    for found in ports:
        if os.path.realpath(found.device) == device:
            return found.serial_number or ''
    return ''


_Self = TypeVar('_Self', bound='SensorClient')

OnBlock = Callable[[StrainBlock], None]
NowNs = Callable[[], int]

FIRST_DELAY_S = 0.25
LONGEST_DELAY_S = 0.5
JOIN_TIMEOUT_S = 5.0

_logger = logging.getLogger(__name__)


class SensorClient(ABC):
    """Base class of the clients, which read one sensor until they are closed.

    A client can be opened only once.

    Parameters
    ----------
    config : TendonSensorConfig
        Kind and parameters of the sensor.
    on_block : callable
        Called with each `StrainBlock` on the client's own thread.
    now_ns : callable
        Returns the present ROS time [ns].

    Attributes
    ----------
    identity : str
        Serial number or another identifier of the sensor; an empty string while it is unknown.
    """

    def __init__(self, config: TendonSensorConfig, on_block: OnBlock, now_ns: NowNs) -> None:
        self.identity = ''
        self._config = config
        self._on_block = on_block
        self._host_ns = now_ns
        self._arrivals = ArrivalClock(now_ns)
        self._stop = threading.Event()
        self._is_connected = False
        self._heard_monotonic_ns = 0
        self._delay_s = FIRST_DELAY_S
        self._reconnects = 0
        self._last_error: str | None = None

    def __enter__(self: _Self) -> _Self:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @abstractmethod
    def open(self) -> None:
        """Open the link and start reading.

        Raises
        ------
        TendonSensorError
            If the sensor cannot be found or does not accept its settings.
        """

    @abstractmethod
    def close(self) -> None:
        """Deliver the samples that have been received, and close the link; idempotent."""

    @abstractmethod
    def health(self) -> SensorHealth:
        """Return the present state of the link."""

    def set_at_rest(self, is_at_rest: bool) -> None:  # noqa: B027
        """Use larger blocks while the tendon is at rest. Can be called from any thread."""

    # -- for subclasses ------------------------------------------------------------------

    def _make_health(self, stream: Stream[Any] | None, **values: Any) -> SensorHealth:
        """Return the health; ``values`` are the fields that not all kinds of sensor have."""
        # The time is derived from the monotonic clock, because the host's clock can be set.
        heard_at_ns = self._host_ns() - (time.monotonic_ns() - self._heard_monotonic_ns)
        common: dict[str, Any] = {'reconnects': self._reconnects, 'last_error': self._last_error}
        if stream is not None:
            clock = stream.clock
            common |= {
                'readings': stream.readings,
                'lost_samples': stream.lost_samples,
                'duplicates': clock.duplicates,
                'late_samples': clock.late_samples,
                'outliers': clock.outliers,
                'restarts': clock.restarts,
                'status': stream.status,
            }
        return SensorHealth(self._is_connected, heard_at_ns, **{**common, **values})

    def _note_heard(self) -> None:
        self._heard_monotonic_ns = time.monotonic_ns()

    def _check_is_new(self, was_opened: bool) -> None:
        if was_opened or self._stop.is_set():
            raise TendonSensorError('this client has been opened before; create a new one')

    def _deliver(self, blocks: list[StrainBlock]) -> None:
        for block in blocks:
            self._hand_out(block)

    def _hand_out(self, block: StrainBlock) -> None:
        try:
            self._on_block(block)
        except Exception as error:
            # An exception of ``on_block`` does not end the stream. It is not logged repeatedly.
            text = f'the consumer of the blocks failed: {error}'
            if text != self._last_error:
                self._last_error = text
                _logger.exception('the consumer of the blocks failed')


class _Link(Protocol):
    def close(self) -> None: ...


LinkType = TypeVar('LinkType', bound=_Link)


class LinkClient(SensorClient, Generic[LinkType]):
    """Base class of clients that read from a link in one thread and reconnect after a loss.

    The first attempt to reconnect follows 0.25 s after the loss, and further attempts every 0.5 s.
    Subclasses must set ``_stream``.
    """

    _stream: Stream[Any]

    def __init__(self, config: TendonSensorConfig, on_block: OnBlock, now_ns: NowNs) -> None:
        super().__init__(config, on_block, now_ns)
        self._link: LinkType | None = None
        name = type(self).__name__
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def open(self) -> None:
        self._check_is_new(self._has_started)
        self._link = self._connect()
        self._note_heard()
        self._is_connected = True
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(JOIN_TIMEOUT_S)
            if self._thread.is_alive():
                self._last_error = 'the consumer of the blocks does not return from on_block'

    def set_at_rest(self, is_at_rest: bool) -> None:
        self._stream.set_at_rest(is_at_rest)

    # -- for subclasses ------------------------------------------------------------------

    @property
    def _has_started(self) -> bool:
        return self._thread.ident is not None

    @abstractmethod
    def _connect(self) -> LinkType:
        """Configure the sensor and start its stream; raise LinkError on failure."""

    @abstractmethod
    def _read(self, link: LinkType) -> None:
        """Read and deliver the received samples; raise LinkError if the link is lost."""

    def _note_loss(self, link: LinkType) -> None:
        """Add the counters of a link that has been closed to the totals."""

    def _wants_pause(self, error: LinkError) -> bool:
        """Return True if the client should wait before it reconnects after this error."""
        return True

    def _note_samples(self, monotonic_ns: int) -> None:
        """Record the monotonic time [ns] at which samples have arrived."""
        self._heard_monotonic_ns = monotonic_ns
        self._delay_s = FIRST_DELAY_S
        if not self._is_connected:
            self._is_connected = True
            self._reconnects += 1

    # -- the thread ----------------------------------------------------------------------

    def _run(self) -> None:
        while not self._stop.is_set():
            self._step()
        self._deliver(self._stream.flush())
        self._is_connected = False
        self._disconnect()

    def _step(self) -> None:
        try:
            if self._link is not None:
                self._read(self._link)
            else:
                self._link = self._connect()
        except LinkError as error:
            self._is_connected = False
            self._last_error = str(error)
            self._deliver(self._stream.flush())
            self._disconnect()
            if self._wants_pause(error):
                self._stop.wait(self._delay_s)
                self._delay_s = min(2 * self._delay_s, LONGEST_DELAY_S)

    def _disconnect(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()
            self._note_loss(link)
