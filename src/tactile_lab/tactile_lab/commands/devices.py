# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile devices`: what is plugged in and recognised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from rich.markup import escape
from rich.table import Table

from tactile_lab.commands.output import Output
from tactile_lab.devices.device_probe import (
    find_names,
    find_ports,
    FoundDevice,
    probe_net_ft,
    probe_ports,
)


def run_devices(
    ports: Sequence[str],
    hosts: Sequence[str],
    *,
    topics: bool = False,
    listen_s: float,
    is_quiet: bool,
    as_json: bool,
) -> None:
    """Print what is found on serial ports and at the addresses of Net F/T boxes.

    Parameters
    ----------
    ports : sequence of str
        Ask these only; empty: all of the computer, unless there are hosts.
    hosts : sequence of str
        Addresses of Net F/T boxes.
    topics : bool
        Look for topics with a force, and at ports and hosts only where they are named.
    listen_s : float
        How long to wait for a line that speaks by itself [s].
    is_quiet : bool
        Send nothing to serial ports.
    as_json : bool
    """
    output = Output(as_json)
    known = {port.port: port for port in find_ports()}
    wanted = [known.get(port, FoundDevice(port, names=find_names(port))) for port in ports]
    if not ports and not hosts and not topics:
        wanted = list(known.values())
    found = probe_ports(wanted, listen_s=listen_s, is_quiet=is_quiet)
    found += [probe_net_ft(host) for host in hosts]
    if topics:
        from tactile_lab.commands.force_topics import find_force_topics

        found += find_force_topics(listen_s)
    if found:
        output.say(_as_table(found))
    elif topics:
        output.say('No node publishes a force on this ROS domain; see "ros2 topic list -t".')
    else:
        output.say(
            'No serial port is there. Check cables and power; adapters show up in the output of '
            '"dmesg". A Net F/T is asked at its address: --net-ft 192.168.1.1'
        )
    output.result({'devices': [asdict(device) for device in found]})


def _as_table(found: Sequence[FoundDevice]) -> Table:
    table = Table('port', 'device', 'what is there', 'parameters', 'other names')
    for device in found:
        cells = (
            device.port,
            device.device or '-',
            '\n'.join(filter(None, (device.what, device.usb))),
            '\n'.join(f'{name}: {value}' for name, value in device.parameters.items()),
            '\n'.join(device.names),
        )
        table.add_row(*map(escape, cells))
    return table
