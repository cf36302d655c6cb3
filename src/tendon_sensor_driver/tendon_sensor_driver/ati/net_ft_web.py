# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The settings of a Net F/T, read and written through its web server."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import http.client
from urllib.parse import urlencode
import xml.etree.ElementTree as ElementTree

import numpy as np
from numpy.typing import NDArray

from tendon_sensor_driver.ati.net_ft_protocol import INTERNAL_RATE_HZ, MOST_RECORDS
from tendon_sensor_driver.ati.units import compute_si_per_count, unit_of_code
from tendon_sensor_driver.errors import LinkError
from tendon_sensor_driver.records import LOW_PASS_CODES

CONFIGURATION_PAGE = '/netftapi2.xml'
HTTP_TIMEOUT_S = 1.0
_MOST_BYTES = 1 << 20


@dataclass(frozen=True, eq=False)
class BoxConfiguration:
    """Configuration that a Net F/T reports on its web interface.

    Attributes
    ----------
    product, serial : str
        Name of the product; serial number of the calibration, empty: not reported.
    si_per_count : ndarray
        Newtons and newton metres of one count of each component, float64, shape (6,).
    internal_rate_hz : float
        Rate of the sample counter [Hz].
    rdt_rate_hz : float
        Rate of the RDT records as the box rounds it [Hz]; 0: not reported.
    low_pass_hz : int
        Cut-off frequency of its low-pass filter [Hz]; 0: off; -1: not reported.
    records_per_datagram : int
        Records per datagram in buffered mode; 0: not reported.
    status : int
        Status word.
    is_rdt_enabled : bool
        RDT is switched on, so the box sends records.
    """

    product: str
    serial: str
    si_per_count: NDArray[np.float64]
    internal_rate_hz: float
    rdt_rate_hz: float
    low_pass_hz: int
    records_per_datagram: int
    status: int
    is_rdt_enabled: bool

    @property
    def is_axia(self) -> bool:
        """True for an Ethernet Axia, whose status bits differ."""
        return 'axia' in self.product.lower()


def parse_configuration(page: bytes) -> BoxConfiguration:
    """Return the configuration from a ``netftapi2.xml`` page.

    Raises
    ------
    LinkError
        When it is no such page, or lacks the calibration.
    """
    if b'<!' in page:  # entities and the like; a box sends none
        raise LinkError('the configuration page of the Net F/T is no plain XML')
    try:
        root = ElementTree.fromstring(page)  # noqa: S314 - no declarations, see above
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise LinkError(f'the configuration page of the Net F/T is no XML: {error}') from error
    tags = {element.tag: (element.text or '').strip() for element in root}
    force_unit = tags.get('scfgfu') or unit_of_code('force', int(_number(tags, 'cfgfu')))
    torque_unit = tags.get('scfgtu') or unit_of_code('torque', int(_number(tags, 'cfgtu')))
    filters = {code: cutoff_hz for cutoff_hz, code in LOW_PASS_CODES.items()}
    # One public stand-in for a box spells the rate with two m.
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
        raise LinkError(f'the configuration page of the Net F/T says {tag} = "{text}"')
    return value


def _status(tags: Mapping[str, str]) -> int:
    try:
        return int(tags.get('runstat', '0'), 16) & 0xFFFFFFFF
    except ValueError as error:
        raise LinkError(f'the Net F/T states its status as "{tags["runstat"]}"') from error


class BoxWeb:
    """The web server of one box; each call is a connection of its own.

    Parameters
    ----------
    host, port
        Where it is.
    """

    def __init__(self, host: str, port: int) -> None:
        self._host = host
        self._port = port

    def read_configuration(self) -> BoxConfiguration:
        """Return the active configuration.

        Raises
        ------
        LinkError
            When the box does not answer, or not with a configuration.
        """
        return parse_configuration(self._get(CONFIGURATION_PAGE))

    def write_settings(self, rate_hz: float, low_pass_hz: int, records: int) -> None:
        """Set rate, filter and records per datagram, and allow RDT.

        Parameters
        ----------
        rate_hz : float
            Rate of the records [Hz]; the box takes the next 7000 / n above it.
        low_pass_hz : int
            Cut-off [Hz], a key of `LOW_PASS_CODES`.
        records : int
            Per datagram in buffered mode, 1 to 40.

        Raises
        ------
        LinkError
            When the box does not answer, or refuses.
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
        if response.status not in (200, 302, 303):  # a box may send the browser back
            raise LinkError(
                f'the Net F/T answers {path} with HTTP status {response.status}: '
                'the setting was refused'
            )
        return body
