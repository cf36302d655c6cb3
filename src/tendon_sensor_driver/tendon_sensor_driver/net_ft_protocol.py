# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Protocol of the ATI Net F/T: units, packets of Raw Data Transfer (RDT), and web pages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
import http.client
import struct
from urllib.parse import urlencode
import xml.etree.ElementTree as ElementTree

import numpy as np
from numpy.typing import NDArray

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver.config import LOW_PASS_CODES, NEWTONS
from tendon_sensor_driver.errors import LinkError

_POUND_N, _KILOGRAM_N = NEWTONS['lbf'], NEWTONS['kg']
_INCH_M = 0.0254

_UNITS = {
    'force': {
        'lbf': _POUND_N,
        'N': 1.0,
        'klbf': 1e3 * _POUND_N,
        'kN': 1e3,
        'kgf': _KILOGRAM_N,
        'gf': 1e-3 * _KILOGRAM_N,
    },
    'torque': {
        'lbf-in': _POUND_N * _INCH_M,
        'lbf-ft': _POUND_N * 12 * _INCH_M,
        'N-m': 1.0,
        'N-mm': 1e-3,
        'kgf-cm': 1e-2 * _KILOGRAM_N,
        'kN-m': 1e3,
    },
}
"""Newtons or newton metres per unit. The units are in the order of ATI's codes 1, 2 and so on."""


def unit_of_code(kind: str, code: int) -> str:
    """Return the unit of ``force`` or ``torque`` for a unit code of ATI.

    Raises `LinkError` if the code is unknown.
    """
    names = tuple(_UNITS[kind])
    if not 1 <= code <= len(names):
        raise LinkError(
            f'the sensor reports the {kind} unit {code}; known units are 1 to {len(names)}'
        )
    return names[code - 1]


def compute_si_per_count(
    force_unit: str, torque_unit: str, counts_per_force: float, counts_per_torque: float
) -> NDArray[np.float64]:
    """Return the value of one count of each component, float64, shape (6,).

    Parameters
    ----------
    force_unit, torque_unit : str
        Units as the sensor spells them; ``Nm`` and ``N-m`` are equivalent.
    counts_per_force, counts_per_torque : float
        Counts per unit.

    Returns
    -------
    ndarray of shape (6,)
        Force [N] and torque [N m] of one count.

    Raises
    ------
    LinkError
        If a unit is unknown, or a number of counts is not positive and finite.
    """
    for name, counts in (('force', counts_per_force), ('torque', counts_per_torque)):
        if not 0 < counts < float('inf'):
            raise LinkError(
                f'the sensor reports {counts} counts per {name} unit; '
                'check that its active configuration has a calibration'
            )
    force_n = _find('force', force_unit) / counts_per_force
    torque_n_m = _find('torque', torque_unit) / counts_per_torque
    return np.array([force_n] * 3 + [torque_n_m] * 3)


def _find(kind: str, name: str) -> float:
    wanted = name.replace('-', '').strip().lower()
    for unit, value in _UNITS[kind].items():
        if unit.replace('-', '').lower() == wanted:
            return value
    raise LinkError(
        f'the sensor reports its {kind} in "{name}"; set it to one of {", ".join(_UNITS[kind])}'
    )


RECORD_BYTES = 36
MOST_RECORDS = 40
"""Largest number of records in one datagram in buffered mode."""
INTERNAL_RATE_HZ = 7000
SATURATED = 1 << 17
CONDITION_LATCHED = 1 << 16
ERROR_SUMMARY = 1 << 31

_HEADER = 0x1234
_REQUEST = struct.Struct('>HHI')

RECORD = np.dtype(
    [('rdt_sequence', '>u4'), ('ft_sequence', '>u4'), ('status', '>u4'), ('counts', '>i4', (6,))]
)
"""One RDT record in network byte order."""

_NET_FT_BITS = {
    30: 'CPU or RAM',
    29: 'digital board',
    28: 'analog board',
    27: 'serial link between transducer and board',
    26: 'program memory',
    25: 'halted by configuration errors',
    24: 'settings',
    23: 'configuration does not fit the calibration',
    22: 'network',
    21: 'CAN',
    20: 'RDT',
    19: 'EtherNet/IP',
    18: 'DeviceNet',
    17: 'transducer saturated or A/D error',
    16: 'monitor condition latched',
    14: 'watchdog timeout',
    13: 'stack check',
    12: 'serial EEPROM',
    11: 'serial flash',
    10: 'analog board watchdog',
    9: 'gauge excitation current too high',
    8: 'gauge excitation current too low',
    7: 'artificial ground out of range',
    6: 'analog supply too high',
    5: 'analog supply too low',
    4: 'serial link data unavailable',
    3: 'reference voltage or power monitor',
    2: 'temperature',
    1: 'HTTP',
}
_AXIA_BITS = {
    30: 'force or torque out of range',
    29: 'calibration checksum',
    28: 'simulated error',
    27: 'gauge out of range',
    16: 'monitor condition latched',
    5: 'other error',
    3: 'busy',
    2: 'broken gauge',
    1: 'supply',
    0: 'temperature',
}
_AXIA_SATURATED = 1 << 27 | 1 << 30


class Command(IntEnum):
    """Command code of an RDT request."""

    STOP = 0x0000
    START_REALTIME = 0x0002
    START_BUFFERED = 0x0003


def encode_request(command: Command) -> bytes:
    """Return an RDT request; a start command requests records without end."""
    return _REQUEST.pack(_HEADER, command, 0)


def decode_records(datagram: bytes) -> NDArray[np.void]:
    """Return the records in a datagram as an array of dtype `RECORD`, shape (records,)."""
    return np.frombuffer(datagram, dtype=RECORD)


def classify_status(words: NDArray[np.uint32], *, is_axia: bool) -> NDArray[np.uint32]:
    """Return the bits of `StrainStatus` for each status word.

    The bit of a latched monitor condition is ignored. It only means that a value has exceeded a
    threshold that the user has set in the sensor. Saturation does not count as a device error.

    Parameters
    ----------
    words : ndarray of uint32, shape (samples,)
        Status words of the records.
    is_axia : bool
        True for the sensor Ethernet Axia, whose status bits have other meanings.

    Returns
    -------
    ndarray of uint32, shape (samples,)
    """
    if not words.any():
        return np.zeros(len(words), dtype=np.uint32)
    saturated = np.uint32(_AXIA_SATURATED if is_axia else SATURATED)
    harmless = saturated | np.uint32(CONDITION_LATCHED | ERROR_SUMMARY)
    is_saturated = (words & saturated) != 0
    # It is also an error if only the summary bit is set.
    is_unexplained = words == ERROR_SUMMARY
    is_error = ((words & ~harmless) != 0) | is_unexplained
    status = np.where(is_saturated, int(StrainStatus.SATURATED), 0)
    status |= np.where(is_error, int(StrainStatus.DEVICE_ERROR), 0)
    return status.astype(np.uint32)


def format_status(word: int, *, is_axia: bool) -> tuple[str, ...]:
    """Return the names of the bits that are set in a status word, highest bit first."""
    bits = _AXIA_BITS if is_axia else _NET_FT_BITS
    words = [bits.get(bit, f'bit {bit}') for bit in range(30, -1, -1) if word >> bit & 1]
    if word & ERROR_SUMMARY and not words:
        words = ['an unspecified error']
    return tuple(words)


def compute_rate_hz(asked_hz: float, internal_hz: float = INTERNAL_RATE_HZ) -> float:
    """Return the rate [Hz] that a sensor uses if ``asked_hz`` is set.

    This is the next higher rate ``internal_hz / n`` with an integer n.
    """
    return internal_hz / max(1, int(internal_hz / asked_hz + 1e-9))


CONFIGURATION_PAGE = '/netftapi2.xml'
HTTP_TIMEOUT_S = 1.0
_MOST_BYTES = 1 << 20


@dataclass(frozen=True, eq=False)
class BoxConfiguration:
    """Configuration that a Net F/T reports on its web interface."""

    product: str
    serial: str  # serial number of the calibration; an empty string if not reported
    # Force [N] and torque [N m] of one count of each component, float64, shape (6,)
    si_per_count: NDArray[np.float64]
    internal_rate_hz: float  # rate of the sample counter [Hz]
    rdt_rate_hz: float  # rate of the RDT records, rounded by the sensor [Hz]; 0: not reported
    low_pass_hz: int  # cut-off frequency of its low-pass filter [Hz]; 0: off; -1: not reported
    records_per_datagram: int  # records per datagram in buffered mode; 0: not reported
    status: int
    is_rdt_enabled: bool  # the sensor is set to send RDT records

    @property
    def is_axia(self) -> bool:
        """True for the sensor Ethernet Axia, whose status bits have other meanings."""
        return 'axia' in self.product.lower()


def parse_configuration(page: bytes) -> BoxConfiguration:
    """Return the configuration on the page ``netftapi2.xml`` of a sensor.

    Raises `LinkError` if the page is invalid.
    """
    if b'<!' in page:  # a sensor sends no declarations, which could exhaust the memory
        raise LinkError('the configuration page of the Net F/T contains XML declarations')
    try:
        root = ElementTree.fromstring(page)  # noqa: S314 - no declarations, see above
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise LinkError(
            f'the configuration page of the Net F/T is not valid XML: {error}'
        ) from error
    tags = {element.tag: (element.text or '').strip() for element in root}
    force_unit = tags.get('scfgfu') or unit_of_code('force', int(_number(tags, 'cfgfu')))
    torque_unit = tags.get('scfgtu') or unit_of_code('torque', int(_number(tags, 'cfgtu')))
    filters = {code: cutoff_hz for cutoff_hz, code in LOW_PASS_CODES.items()}
    # A public simulator of the sensor spells this tag with "mm".
    rate_tag = 'comrdtrate' if 'comrdtrate' in tags else 'commrdtrate'
    return BoxConfiguration(
        product=tags.get('prodname', ''),
        serial=tags.get('cfgcalsn') or tags.get('setserial', ''),
        si_per_count=compute_si_per_count(
            force_unit, torque_unit, _number(tags, 'cfgcpf'), _number(tags, 'cfgcpt')
        ),
        internal_rate_hz=_number(tags, 'runrate', INTERNAL_RATE_HZ) or INTERNAL_RATE_HZ,
        rdt_rate_hz=_number(tags, rate_tag, 0.0),
        low_pass_hz=filters.get(int(_number(tags, 'setuserfilter', -1.0)), -1),
        records_per_datagram=int(_number(tags, 'comrdtbsiz', 0.0)),
        status=_status(tags),
        is_rdt_enabled=tags.get('comrdte', 'Enabled') in ('Enabled', '1'),
    )


def _number(tags: Mapping[str, str], tag: str, default: float | None = None) -> float:
    text = tags.get(tag)
    if text is None and default is not None:
        return default
    try:
        value = float(text or '')
    except ValueError:
        value = float('nan')
    if not 0 <= abs(value) < 1e15:
        raise LinkError(
            f'the configuration page of the Net F/T has {tag} = "{text}"; a number is needed'
        )
    return value


def _status(tags: Mapping[str, str]) -> int:
    try:
        return int(tags.get('runstat', '0'), 16) & 0xFFFFFFFF
    except ValueError as error:
        raise LinkError(
            f'the Net F/T reports the status "{tags["runstat"]}"; a hexadecimal number is needed'
        ) from error


class BoxWeb:
    """Client of the web server of one Net F/T; each call opens a connection.

    All methods raise LinkError if the sensor does not answer or refuses a setting.
    """

    def __init__(self, host: str, port: int) -> None:
        self._host = host
        self._port = port

    def read_configuration(self) -> BoxConfiguration:
        """Return the active configuration."""
        return parse_configuration(self._get(CONFIGURATION_PAGE))

    def write_settings(self, rate_hz: float, low_pass_hz: int, records: int) -> None:
        """Set rate, filter and records per datagram, and enable RDT.

        Parameters
        ----------
        rate_hz : float
            Rate of the records [Hz]; see `compute_rate_hz` for the rate that the sensor uses.
        low_pass_hz : int
            Cut-off frequency of the low-pass filter [Hz], a key of `LOW_PASS_CODES`.
        records : int
            Records per datagram, 1 to 40.
        """
        self._set('setting.cgi', setuserfilter=LOW_PASS_CODES[low_pass_hz])
        self._set(
            'comm.cgi',
            comrdte=1,
            comrdtrate=max(1, round(rate_hz)),
            comrdtbsiz=max(1, min(records, MOST_RECORDS)),
        )

    def _set(self, page: str, **settings: int) -> None:
        self._get(f'/{page}?{urlencode(settings)}')

    def _get(self, path: str) -> bytes:
        connection = http.client.HTTPConnection(self._host, self._port, timeout=HTTP_TIMEOUT_S)
        try:
            connection.request('GET', path)
            response = connection.getresponse()
            body = response.read(_MOST_BYTES)
        except (OSError, http.client.HTTPException) as error:
            raise LinkError(
                f'no answer from the web server of the Net F/T at {self._host}:{self._port}: '
                f'{error}; check its power, cable and the parameters "host" and "http_port"'
            ) from error
        finally:
            connection.close()
        if response.status not in (200, 302, 303):  # a sensor may answer with a redirection
            raise LinkError(
                f'the Net F/T answers {path} with HTTP status {response.status}; check the '
                'settings on its web page'
            )
        return body
