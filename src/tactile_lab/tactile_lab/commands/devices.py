# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile devices`: list the connected devices."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Annotated, Optional, TYPE_CHECKING

import typer

from tactile_lab import options
from tactile_lab.console import Prose, Table
from tactile_lab.output import Output

if TYPE_CHECKING:
    from tactile_lab.devices.device_probe import FoundDevice


def devices(
    port: Annotated[
        Optional[list[str]],
        typer.Option(
            help='Probe only this serial port; may be given several times. Needed for ports that '
            'the computer does not list, such as links made by `tactile_sim_rig`.'
        ),
    ] = None,
    net_ft: Annotated[
        Optional[list[str]],
        typer.Option(
            metavar='HOST',
            help='Probe an ATI Net F/T at this address; may be given several times.',
        ),
    ] = None,
    listen: Annotated[
        float,
        typer.Option(
            min=0.1,
            max=60.0,
            help='Seconds to wait for a device that sends data without a request. A board that is '
            'reset by opening its port needs two.',
        ),
    ] = 2.5,
    topics: Annotated[
        bool,
        typer.Option(
            '--topics', help='List topics on which other nodes publish a force, instead of ports.'
        ),
    ] = False,
    quiet: Annotated[
        bool, typer.Option('--quiet', help='Send nothing to serial ports; only listen.')
    ] = False,
    as_json: options.JsonOption = False,
) -> None:
    """List the connected devices and the parameters that fit them.

    Lists every serial port with its USB numbers and persistent names, and the device on it: a
    linear guide (Grbl), a Dynamixel servo, a load cell that sends lines, or an ATI Net F/T at a
    given address. Also prints the parameters of the node for this device. With ``--topics``,
    lists the topics of this ROS domain on which other nodes publish a force.

    Nothing is moved. If a device sends data without a request, the command only listens. To a
    silent port it sends a question mark, which Grbl answers and other devices ignore, and then a
    Dynamixel ping at each usual baud rate. If you have other devices that must not receive these
    bytes, select ports with ``--port``, or use ``--quiet``. Some boards reset when their port is
    opened; a Grbl guide must be homed after that. Ports that another program has open are skipped.
    """
    from tactile_lab.devices.device_probe import (
        find_names,
        find_ports,
        FoundDevice,
        probe_net_ft,
        probe_ports,
    )

    output = Output(as_json)
    ports, hosts = port or (), net_ft or ()
    known = {found.port: found for found in find_ports()}
    wanted = [known.get(name, FoundDevice(name, names=find_names(name))) for name in ports]
    if not ports and not hosts and not topics:
        wanted = list(known.values())
    found = probe_ports(wanted, listen_s=listen, is_quiet=quiet)
    found += [probe_net_ft(host) for host in hosts]
    if topics:
        from tactile_lab.force_topics import find_force_topics  # imports rclpy

        found += find_force_topics(listen)
    if found:
        output.say(_as_table(found))
    elif topics:
        output.say(
            'No node publishes a force on this ROS domain. Start the node of the sensor; it must '
            'have the same ROS_DOMAIN_ID.'
        )
    else:
        output.say(
            'There are no serial ports. Check cables and power; `dmesg` lists adapters that were '
            'plugged in. For a Net F/T, give its address: --net-ft 192.168.1.1'
        )
    output.result({'devices': [asdict(device) for device in found]})


def _as_table(found: Sequence['FoundDevice']) -> Table:
    columns = ('port', 'device', 'description', 'parameters', 'other names')
    table = Table(*columns, spare=['other names'])
    for device in found:
        table.add_row(
            device.port,
            device.device or '-',
            Prose('; '.join(filter(None, (device.what, device.usb)))),
            [f'{name}: {value}' for name, value in device.parameters.items()],
            device.names,
        )
    return table
