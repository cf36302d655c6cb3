# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Discovery of connected devices: serial ports, and the device on each port.

A probe moves no device. If a device sends data without a request, the probe only reads. To a
silent port it sends a single ``?``, which Grbl answers with its status and other devices ignore,
and then the ping of the Dynamixel protocol.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise
import os
from pathlib import Path
import re
import time
from typing import Any

import dynamixel_sdk
import serial
from serial.tools import list_ports

from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.bus import READ_WAIT_S
from linear_guide_driver.serial_link import LINE_ERRORS
from tendon_sensor_driver.config import TendonSensorConfig
from tendon_sensor_driver.errors import LinkError
from tendon_sensor_driver.line_sensor import LineDecoder, split_line, UNITS
from tendon_sensor_driver.net_ft_protocol import BoxWeb

LISTEN_S = 2.5
"""Time for a board to boot and send its banner, if opening its port has reset it [s]."""

NAME_FOLDERS = ('/dev/tactile', '/dev/serial/by-id')
"""Folders of persistent port names: from our rules (``udev/60-tactile.rules``), from udev."""

USUAL_BAUD = 115_200
OTHER_BAUDS = (9600, 57_600, 38_400, 19_200, 1_000_000)
SERVO_BAUDS = (57_600, 1_000_000, 115_200, 2_000_000, 3_000_000, 4_000_000)

SERVO_MODELS = {**registers.MODELS, 1190: 'XL330-M077', 1200: 'XL330-M288'}
_ANSWER_S = 0.5
_ENOUGH_LINES = 5
_TICK_S = 0.05
_MOST_PORTS_AT_ONCE = 8

_match_banner = re.compile(rb'^Grbl(?:HAL)? \d\S*', re.MULTILINE).search
_match_status = re.compile(rb'<(\w+)(?::\d)?\|[^<>\r\n]*>').search
_match_build = re.compile(rb'\[VER:([^\]\r\n]*)\]').search
_match_value = re.compile(rb'[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?([A-Za-z]*)').fullmatch
_match_time = re.compile(rb'\d{1,15}(?:\.(\d{1,9}))?').fullmatch


@dataclass(frozen=True)
class FoundDevice:
    """One serial port, Net F/T address or topic, and the device there.

    ``device`` is guide, tendon or sensor; empty if the device is unknown. ``what`` is a
    description. ``usb`` is product, ``vid:pid`` and serial number, as far as known. ``names`` are
    persistent names of the port. ``parameters`` are the parameters of the node for this device.
    """

    port: str
    device: str = ''
    what: str = ''
    usb: str = ''
    names: tuple[str, ...] = ()
    parameters: dict[str, Any] = field(default_factory=dict)


# -- without IO ----------------------------------------------------------------------------


def recognise(data: bytes) -> tuple[str, str, dict[str, Any]] | None:
    """Recognise a device by the bytes that it has sent.

    ``data`` may begin in the middle of a line. Returns the kind of device, a description, and
    parameters of its node; None if the device is unknown.
    """
    if banner := _match_banner(data):
        return 'guide', f'Grbl: "{banner.group().decode("ascii", "replace")}"', {}
    if status := _match_status(data):
        return 'guide', f'Grbl, in state {status.group(1).decode()}', {}
    if b'System Configuration' in data and data.rstrip().endswith(b'>'):
        return 'sensor', 'OpenScale, waiting in its settings menu; send it an "x"', {}
    lines = [line.strip() for line in data.replace(b'\r', b'\n').split(b'\n')[1:-1]]
    lines = [line for line in lines if line]
    if len(lines) < _ENOUGH_LINES or any(not 0x20 <= byte < 0x7F for byte in lines[-1]):
        return None
    # The first lines may be text, such as a banner.
    rows = [split_line(line) for line in lines[-_ENOUGH_LINES:]]
    width = len(rows[0])
    if any(len(row) != width for row in rows):
        return None
    numeric = [i for i in range(width) if all(_is_value(row[i]) for row in rows)]
    if not numeric:
        return None
    parameters = _read_columns(rows, numeric)
    example = lines[-1][:60].decode('ascii', 'replace')
    sentence = f'load-cell lines such as "{example}"'
    if reason := _find_refusal(lines[-_ENOUGH_LINES:], parameters):
        return 'sensor', f'{sentence}, which are refused: {reason}', {}
    return 'sensor', sentence, parameters


def _is_value(text: bytes) -> bool:
    found = _match_value(text)
    return found is not None and (not found[1] or found[1] in UNITS)


def _find_refusal(lines: list[bytes], parameters: dict[str, Any]) -> str | None:
    """Return why the driver would reject all of these lines; None if it accepts one."""
    try:
        decoder = LineDecoder(TendonSensorConfig(rate_hz=0.1, **parameters))  # any rate works
    except ValueError as error:
        return str(error)
    readings = decoder.feed(b'\n' + b'\n'.join(lines) + b'\n', 0)
    return None if readings else decoder.last_reason


def _read_columns(rows: list[list[bytes]], numeric: list[int]) -> dict[str, Any]:
    parameters = _read_time([row[numeric[0]] for row in rows]) if len(numeric) > 1 else {}
    has_time = bool(parameters)
    value = numeric[1] if has_time else numeric[0]
    unit = b''
    if found := _match_value(rows[0][value]):
        unit = found[1] or (rows[0][value + 1] if value + 1 < len(rows[0]) else b'')
    return {
        'time_column': numeric[0] if has_time else -1,
        **parameters,
        'value_column': value,
        **({'unit': UNITS[unit]} if unit in UNITS else {}),
    }


def _read_time(texts: list[bytes]) -> dict[str, Any]:
    """Return the parameters of a time column, or an empty dictionary.

    The column must increase with every line.
    """
    matches = [_match_time(text) for text in texts]
    decimals = {len(match.group(1) or b'') for match in matches if match}
    if not all(matches) or len(decimals) != 1:
        return {}
    if any(float(b) <= float(a) for a, b in pairwise(texts)):
        return {}
    (count,) = decimals
    # In all known sketches, a time with a decimal point is in seconds.
    return {'time_unit_s': 1.0, 'time_decimals': count} if count else {'time_unit_s': 0.001}


# -- ports ---------------------------------------------------------------------------------


def find_ports() -> list[FoundDevice]:
    """Return the serial ports of this computer, without opening them."""
    return [
        FoundDevice(
            port=port.device,
            usb=_format_usb(port),
            names=find_names(port.device),
        )
        for port in sorted(list_ports.comports())
        if port.vid is not None or not port.device.startswith('/dev/ttyS')
    ]


def _format_usb(port: Any) -> str:
    if port.vid is None:
        return ''
    parts = [port.product or port.description, f'{port.vid:04x}:{port.pid:04x}']
    return ' '.join(filter(None, [*parts, port.serial_number and f'serial {port.serial_number}']))


def find_names(port: str, folders: Sequence[str] = NAME_FOLDERS) -> tuple[str, ...]:
    """Return the names of a port: the links to it in these folders."""
    target = os.path.realpath(port)
    links = (link for folder in folders for link in sorted(Path(folder).glob('*')))
    return tuple(str(link) for link in links if os.path.realpath(link) == target)


def find_holders(port: str) -> list[str]:
    """Return this user's programs that have a port open, as ``name (process id)``."""
    target = os.path.realpath(port)
    handles = Path('/proc').glob('[0-9]*/fd/*')
    return sorted({_name_process(h.parent.parent) for h in handles if _leads_to(h, target)})


def _leads_to(link: Path, target: str) -> bool:
    try:
        return str(link.readlink()) == target
    except OSError:  # closed in the meantime, or of another user
        return False


def _name_process(folder: Path) -> str:
    try:
        return f'{(folder / "comm").read_text().strip()} ({folder.name})'
    except OSError:
        return f'a program that has just ended ({folder.name})'


def probe_ports(
    ports: Sequence[FoundDevice], *, listen_s: float = LISTEN_S, is_quiet: bool = False
) -> list[FoundDevice]:
    """Probe ports in parallel; return a `FoundDevice` for each port.

    ``listen_s`` is the time to wait for a device that sends data without a request [s]. If
    ``is_quiet`` is True, nothing is sent.
    """
    with ThreadPoolExecutor(_MOST_PORTS_AT_ONCE) as pool:
        return list(pool.map(lambda port: probe_port(port, listen_s, is_quiet), ports))


def probe_port(found: FoundDevice, listen_s: float, is_quiet: bool) -> FoundDevice:
    """Probe one port; see `probe_ports`."""
    # The simulated rig itself has its ports (ptys) open, so they would always be in use. A driver
    # on such a port is found later, by its lock.
    holders = (
        [] if os.path.realpath(found.port).startswith('/dev/pts/') else find_holders(found.port)
    )
    if holders:
        return replace(found, what=f'in use by {", ".join(holders)}')
    try:
        with serial.Serial(
            found.port, USUAL_BAUD, timeout=_TICK_S, write_timeout=1.0, exclusive=True
        ) as line:
            spoke, answer = _ask_line(line, listen_s, is_quiet)
        if answer is None and not spoke and not is_quiet:
            answer = _ping_servos(found.port)
    except (*LINE_ERRORS, ValueError) as error:
        return replace(found, what=_format_failure(error))
    if answer is None:
        what = 'sends data of an unknown device' if spoke else 'silent'
        return replace(found, what=what)
    device, what, parameters = answer
    return replace(found, device=device, what=what, parameters=parameters)


def _format_failure(error: Exception) -> str:
    number = getattr(error, 'errno', None)
    if number in (11, 16):
        return 'in use by another program'
    if number == 13:
        return 'no permission; add yourself to its group (usually dialout) and log in again'
    if number == 2:
        return 'no such port; check the cable and the name'
    return f'cannot be opened: {error}'


def _ask_line(
    line: serial.Serial, listen_s: float, is_quiet: bool
) -> tuple[bool, tuple[str, str, dict[str, Any]] | None]:
    """Listen and, if necessary, send ``?``.

    Return whether the device sends data without a request, and the result of `recognise`.
    """
    data = _listen(line, listen_s)
    answer = recognise(data)
    baud = USUAL_BAUD
    if data and answer is None:
        for baud in OTHER_BAUDS:
            line.baudrate = baud
            line.reset_input_buffer()
            answer = recognise(_listen(line, listen_s))
            if answer is not None:
                break
    elif not data and not is_quiet:
        line.write(b'?')
        answer = recognise(_listen(line, _ANSWER_S))
    if answer is None:
        return bool(data), None
    device, what, parameters = answer
    if device == 'guide' and not is_quiet:
        what = _ask_build(line, what)
    return bool(data), (device, what, {'baud': baud, **parameters})


def _listen(line: serial.Serial, seconds: float) -> bytes:
    """Receive data until the device is recognised or ``seconds`` have passed; return the data."""
    data = b''
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        data += line.read(line.in_waiting or 1)
        if recognise(data) is not None:
            # Receive the rest of a banner, or of the line.
            time.sleep(_TICK_S)
            return data + line.read(line.in_waiting)
    return data


def _ask_build(line: serial.Serial, what: str) -> str:
    """Return a description of a Grbl guide, with its version if the guide is at rest.

    A moving guide is not asked for its version, so that the motion is not disturbed.
    """
    line.write(b'?')
    status = _match_status(_listen(line, _ANSWER_S))
    if status is None or status.group(1) not in (b'Idle', b'Alarm'):
        return what
    line.write(b'$I\n')
    until_s, data = time.monotonic() + _ANSWER_S, b''
    while b'ok\r\n' not in data and time.monotonic() < until_s:
        data += line.read(line.in_waiting or 1)
    build = _match_build(data)
    version = build.group(1).decode('ascii', 'replace').rstrip(':') if build else 'unknown'
    return f'Grbl {version}, in state {status.group(1).decode()}'


def _ping_servos(port: str) -> tuple[str, str, dict[str, Any]] | None:
    handler: Any = dynamixel_sdk.PortHandler(port)
    packets: Any = dynamixel_sdk.PacketHandler(2.0)
    try:
        for baud in SERVO_BAUDS:
            if not handler.setBaudRate(baud):
                continue
            handler.ser.exclusive = True
            handler.ser.timeout = READ_WAIT_S  # the SDK reads in a loop
            servos, _ = packets.broadcastPing(handler)
            if servos:
                return _format_servos(servos, baud)
    finally:
        if handler.ser is not None:
            handler.closePort()
    return None


def _format_servos(servos: dict[int, list[int]], baud: int) -> tuple[str, str, dict[str, Any]]:
    texts = [
        f'{SERVO_MODELS.get(model, f"model {model}")} with ID {number}, firmware {firmware}'
        for number, (model, firmware) in sorted(servos.items())
    ]
    return 'tendon', f'Dynamixel {"; ".join(texts)}', {'baud': baud, 'device_id': min(servos)}


# -- Net F/T -------------------------------------------------------------------------------


def probe_net_ft(host: str, http_port: int = 80) -> FoundDevice:
    """Return the Net F/T at an address. Only the web page of its configuration is read."""
    try:
        box = BoxWeb(host, http_port).read_configuration()
    except LinkError as error:
        return FoundDevice(host, what=str(error))
    serial_number = f', calibration {box.serial}' if box.serial else ''
    records = f'{box.rdt_rate_hz:g} records/s' if box.is_rdt_enabled else 'RDT is switched off'
    return FoundDevice(
        host,
        'sensor',
        f'{box.product or "Net F/T"}{serial_number}, {records}, status 0x{box.status:08x}',
        parameters={'sensor': 'net_ft', 'host': host},
    )
