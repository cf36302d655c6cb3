# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands that find devices, test and calibrate them."""

import typer

from tactile_lab.cli.request_options import spread
from tactile_lab.commands.rig_requests import CalibrateRequest, CheckRequest, DevicesRequest
from tactile_lab.options import check_paths, JsonOption


@spread
def devices(request: DevicesRequest, as_json: JsonOption = False) -> None:
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
    from tactile_lab.commands.devices import run_devices

    run_devices(request, as_json=as_json)


@spread
def check(request: CheckRequest, as_json: JsonOption = False) -> None:
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
    check_paths(request.params)
    from tactile_lab.commands.check import run_check

    is_fit = run_check(request, as_json=as_json)
    raise typer.Exit(0 if is_fit else 1)


@spread
def calibrate(request: CalibrateRequest, as_json: JsonOption = False) -> None:
    """Calibrate a load cell against known weights.

    The command prints which weight to hang, from the smallest to the largest and back. Each
    reading is the mean of a settled second, without outliers. Fits a line and prints `scale` and
    `offset_n` with their standard uncertainties, the error of the line at every weight, and the
    hysteresis.

    End the sensor's node first: only one program can open a port. Six-axis sensors have the
    calibration of their maker and are refused. `g` lies between 9.780 (equator) and 9.832 m/s^2
    (poles), so its default is wrong by up to 0.3 %.
    """
    from tactile_lab.commands.calibrate import run_calibrate

    run_calibrate(request, as_json=as_json)
