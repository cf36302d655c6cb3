# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile check`: test each device and report the results."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict, replace
from typing import Annotated, Any, TYPE_CHECKING

import typer

from tactile_lab import options
from tactile_lab.console import Prose, Table
from tactile_lab.output import Output
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_lab.devices.checks import CheckReport

_NODES = {'sensor': 'tendon_sensor', 'guide': 'linear_guide', 'tendon': 'tendon_actuator'}


def check(
    given: options.RigOptions = options.RIG,
    namespace: Annotated[str, typer.Option(help='Namespace of the nodes in --params.')] = '',
    seconds: Annotated[
        float, typer.Option(min=1.0, max=3600.0, help='Duration of the test of the sensor [s].')
    ] = 5.0,
    may_move: Annotated[
        bool,
        typer.Option(
            '--move',
            help='Also home the guide and move it 5 mm; tighten the tendon 2 mm and slacken it.',
        ),
    ] = False,
    seed: options.SeedOption = 1,
    as_json: options.JsonOption = False,
) -> None:
    """Test each device and print the results; exit with 1 when there is a fault.

    Tests the devices whose port or topic is given as an option, or whose ``port`` (or ``sensor``)
    is in the file of ``--params``. End all nodes of the rig first, because only one program can
    open a port.

    **Sensor**: rate compared with ``rate_hz``, noise, lost samples, error of the time stamps,
    status bits. Do not touch the tendon during this test.

    **Guide**: firmware version, and settings that would distort a glide without an error message.
    The controller is reset. With ``--move``, the guide is homed, moved and moved back.

    **Tendon**: model, firmware, voltage, temperature, errors, and whether the bus watchdog stops
    the servo when the bus is silent. For this test, the servo holds its position; before and after
    the test, its torque is off.

    Each fault is printed with its remedy.
    """
    from tactile_lab.running import open_ports, refuse_two_sensors

    output = Output(as_json)
    refuse_two_sensors(given)
    if given.simulated:
        output.say('SIMULATED rig: no number is a measurement.')
    reports = []
    with ExitStack() as stack:
        if given.simulated:
            ports, _ = open_ports(given, seed, stack)
            given = replace(given, **asdict(ports))
        wanted = _read_parameters(given, namespace)
        for report in _list_checks(wanted, namespace, seconds, may_move, stack):
            reports.append(report)
            output.say(_as_table(report))
    is_fit = not any(report.problems for report in reports)
    output.say('Ready for trials.' if is_fit else 'Not ready for trials; see the remedies above.')
    output.result(
        {
            'simulated': given.simulated or any('simulated' in report.facts for report in reports),
            'fit': is_fit,
            'devices': [asdict(report) for report in reports],
        }
    )
    raise typer.Exit(0 if is_fit else 1)


def _read_parameters(given: options.RigOptions, namespace: str) -> dict[str, dict[str, Any]]:
    """Return the parameters of each device that is to be tested, by its name in `_NODES`."""
    from tactile_bringup.launch_config.graph import PORTLESS_SENSORS, sensor_parameters
    from tactile_bringup.launch_config.parameter_files import ParameterFile

    file = ParameterFile(given.params)
    wanted: dict[str, dict[str, Any]] = {}
    for name, node in _NODES.items():
        port = getattr(given, name)
        wanted[name] = {**file.of(node, namespace), **({'port': port} if port else {})}
    if given.sensor_topic:
        stated = {_NODES['sensor']: wanted['sensor']}
        wanted['sensor'] |= sensor_parameters(stated, topic=given.sensor_topic) or {}
    # A device is tested if it has a port or topic. A Net F/T has a default address.
    named = {
        name: of_node
        for name, of_node in wanted.items()
        if 'port' in of_node or of_node.get('sensor') in PORTLESS_SENSORS
    }
    if not named:
        raise TactileError(
            'choose what to test: --sensor, --guide or --tendon with a port, --sensor-topic, '
            '--params with a file that contains ports, or --simulated; "tactile devices" lists '
            'the connected devices'
        )
    return named


def _list_checks(
    wanted: dict[str, dict[str, Any]],
    namespace: str,
    seconds: float,
    may_move: bool,
    stack: ExitStack,
) -> Iterator['CheckReport']:
    """Test the devices one after the other; yield the report of each."""
    from tactile_lab.devices import checks
    from tendon_sensor_driver.sensors import make_sensor

    # Invalid parameters are reported before the first test.
    configs = {name: checks.make_config(_NODES[name], of_node) for name, of_node in wanted.items()}
    if sensor := configs.get('sensor'):
        make: checks.MakeSensor = make_sensor
        if sensor.sensor == 'topic':
            from tactile_lab.force_topics import sensors_on_topics  # imports rclpy

            make = stack.enter_context(sensors_on_topics(namespace))
        yield checks.check_sensor_samples(sensor, seconds, make)
    if guide := configs.get('guide'):
        yield checks.check_guide(guide, may_move)
    if tendon := configs.get('tendon'):
        yield checks.check_tendon(tendon, may_move)


def _as_table(report: 'CheckReport') -> Table:
    table = Table(title=f'{report.device} on {report.link}')
    for name, value in report.facts.items():
        table.add_row(name, Prose(value))
    for problem in report.problems:
        table.add_row('WRONG', Prose(problem.what), style='red')
        if problem.remedy:
            table.add_row('remedy', Prose(problem.remedy))
    if not report.problems:
        table.add_row('ready for trials', 'yes', style='green')
    return table
