# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The commands that look for devices and exercise them."""

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
    """List what is plugged in and recognised.

    Every serial port with its USB numbers and the names that stay, and what answers there:
    a linear guide (Grbl), a Dynamixel servo, a load cell that sends lines, or an ATI Net F/T
    at an address that you give. Beside it stand the parameters of the node that fit. With
    ``--topics``, the forces that other nodes publish on this ROS domain.

    Nothing is moved. A port that speaks by itself is only listened to; a silent one is sent a
    question mark, which Grbl answers and others ignore, and then a Dynamixel ping at each usual
    baud rate. Do not let it ask a silent device of another kind that must not hear that: name
    the ports with ``--port``, or use ``--quiet``. A board that resets when its port is opened
    does so here, too: a Grbl guide must be homed afterwards. Ports that another program has
    open are left alone.
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
    """Exercise each device and print what it found; exit with 1 when something is wrong.

    Devices are those whose port or topic is given here, or whose ``port`` (without one:
    ``sensor``) stands in ``--params``. No node of the rig may run meanwhile: a port has one user.

    **Sensor**: rate against ``rate_hz``, noise, lost samples, error of the time stamps, status
    bits. Leave the tendon alone while it listens.

    **Guide**: version, and the settings that would silently change a glide. The controller is
    reset, with ``--move`` homed, moved and brought back.

    **Tendon**: model, firmware, voltage, temperature, errors, and whether the bus watchdog
    stops the servo in silence. For that the tendon is let loose, then held where it stands,
    and let loose again at the end.

    Each fault comes with its remedy.
    """
    with refusals():
        check_paths(request.params)
        from tactile_lab.commands.check import run_check

        is_fit = run_check(request, as_json=json_output)
    raise typer.Exit(0 if is_fit else 1)
