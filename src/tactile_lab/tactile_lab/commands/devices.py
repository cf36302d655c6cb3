# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile devices`: what is plugged in and recognised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from rich.markup import escape
from rich.table import Table

from tactile_lab.commands.output import Output
from tactile_lab.commands.rig_requests import DevicesRequest
from tactile_lab.devices.device_probe import (
    find_names,
    find_ports,
    FoundDevice,
    probe_net_ft,
    probe_ports,
)


def run_devices(request: DevicesRequest, *, as_json: bool) -> None:
    """Print what is found on serial ports, at the addresses of Net F/T boxes, and on topics."""
    output = Output(as_json)
    ports, hosts = request.port or (), request.net_ft or ()
    known = {port.port: port for port in find_ports()}
    wanted = [known.get(port, FoundDevice(port, names=find_names(port))) for port in ports]
    if not ports and not hosts and not request.topics:
        wanted = list(known.values())
    found = probe_ports(wanted, listen_s=request.listen, is_quiet=request.quiet)
    found += [probe_net_ft(host) for host in hosts]
    if request.topics:
        from tactile_lab.commands.force_topics import find_force_topics

        found += find_force_topics(request.listen)
    if found:
        output.say(_as_table(found))
    elif request.topics:
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
