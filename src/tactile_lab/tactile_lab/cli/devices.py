# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands that find devices and test them."""

from typing import Annotated, Optional

import typer

from tactile_lab.cli.request_options import spread
from tactile_lab.commands.rig_requests import CheckRequest
from tactile_lab.options import (
    check_paths,
    JsonOption,
    refusals,
)


def devices(
    port: Annotated[
        Optional[list[str]],
        typer.Option(
            help='Ask this serial port only; may be given several times. Needed for ports that '
            'the computer does not list, such as those of `tactile_sim_rig --links`.'
        ),
    ] = None,
    net_ft: Annotated[
        Optional[list[str]],
        typer.Option(
            '--net-ft',
            metavar='HOST',
            help='Ask an ATI Net F/T at this address; may be given several times.',
        ),
    ] = None,
    listen: Annotated[
        float,
        typer.Option(
            min=0.1,
            max=60.0,
            help='Seconds to wait for a port that speaks by itself. A board that is reset by '
            'opening its port needs two.',
        ),
    ] = 2.5,
    topics: Annotated[
        bool,
        typer.Option(
            '--topics', help='List topics on which other nodes publish a force, instead of ports.'
        ),
    ] = False,
    quiet: Annotated[
        bool, typer.Option('--quiet', help='Send nothing to serial ports: listen only.')
    ] = False,
    json_output: JsonOption = False,
) -> None:
    """List the connected devices and the parameters that fit them.

    Lists every serial port with its USB numbers and persistent names, and the device there: a
    linear guide (Grbl), a Dynamixel servo, a load cell that sends lines, or an ATI Net F/T at an
    address that you give. Prints the node parameters that fit. With ``--topics``, lists the
    forces that other nodes publish on this ROS domain.

    Nothing is moved. Nothing is sent to a port that sends data by itself. A silent port is sent a
    question mark, which Grbl answers and others ignore, and then a Dynamixel ping at each usual
    baud rate. If another silent device must not receive these, name the ports with ``--port`` or
    use ``--quiet``. A board that resets when its port is opened does so here, too: a Grbl guide
    must be homed afterwards. Ports that another program has open are left alone.
    """
    with refusals():
        from tactile_lab.commands.devices import run_devices

        run_devices(
            port or [],
            net_ft or [],
            topics=topics,
            listen_s=listen,
            is_quiet=quiet,
            as_json=json_output,
        )


@spread
def check(request: CheckRequest, json_output: JsonOption = False) -> None:
    """Test each device and print the results; exit with 1 when there is a fault.

    Tests the devices whose port or topic is given here, or whose ``port`` (or ``sensor``) is in
    the file of ``--params``. End all nodes of the rig first: only one program can open a port.

    **Sensor**: rate against ``rate_hz``, noise, lost samples, error of the time stamps, status
    bits. Leave the tendon alone while it listens.

    **Guide**: version, and the settings that would silently change a glide. The controller is
    reset, with ``--move`` homed, moved and brought back.

    **Tendon**: model, firmware, voltage, temperature, errors, and whether the bus watchdog
    stops the servo in silence. For this the tendon is released, held where it is, and
    released again at the end.

    Each fault comes with its remedy.
    """
    with refusals():
        check_paths(request.params)
        from tactile_lab.commands.check import run_check

        is_fit = run_check(request, as_json=json_output)
    raise typer.Exit(0 if is_fit else 1)
