# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile check`: exercise each device and say what it found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
import dataclasses
from functools import partial
from typing import Any, TypeVar

from rich.markup import escape
from rich.table import Table

from linear_guide_driver.records import LinearGuideConfig, TendonActuatorConfig
from tactile_bringup.launch_config.graph import PORTLESS_SENSORS, sensor_parameters
from tactile_bringup.launch_config.parameter_files import ParameterFile
from tactile_lab.commands.output import Output
from tactile_lab.commands.rig_requests import CheckRequest
from tactile_lab.commands.running.rig import open_ports
from tactile_lab.devices.device_checks import (
    check_guide,
    check_tendon,
    CheckReport,
)
from tactile_lab.devices.sensor_checks import check_sensor, MakeSensor
from tactile_ros.errors import TactileError
from tendon_sensor_driver.records import TendonSensorConfig
from tendon_sensor_driver.sensors import make_sensor

_NODES = {'sensor': 'tendon_sensor', 'guide': 'linear_guide', 'tendon': 'tendon_actuator'}
_Config = TypeVar('_Config')


def run_check(request: CheckRequest, *, as_json: bool) -> bool:
    """Check each configured device; return whether nothing is wrong.

    Raises
    ------
    TactileError
        When no device is named, or the parameters do not fit.
    """
    output = Output(as_json)
    if request.ports.simulated:
        output.say('SIMULATED rig: no number is a measurement.')
    with ExitStack() as stack:
        reports = []
        for check in _plan_checks(request, stack):
            reports.append(check())
            output.say(_as_table(reports[-1]))
    is_fit = not any(report.problems for report in reports)
    output.say('All fit.' if is_fit else 'Not fit for trials.')
    output.result(
        {
            'simulated': request.ports.simulated
            or any('simulated' in report.facts for report in reports),
            'fit': is_fit,
            'devices': [dataclasses.asdict(report) for report in reports],
        }
    )
    return is_fit


def _plan_checks(request: CheckRequest, stack: ExitStack) -> list[Callable[[], CheckReport]]:
    """Return the check of each device that is configured."""
    file = ParameterFile(request.params)
    given: Any = request.ports
    if request.ports.simulated:
        given, _ = open_ports(request.ports, request.seed, stack)
    wanted: dict[str, dict[str, Any]] = {}
    for name, node in _NODES.items():
        port = getattr(given, name)
        wanted[name] = {**file.of(node, request.namespace), **({'port': port} if port else {})}
    if request.ports.sensor_topic:
        stated = {_NODES['sensor']: wanted['sensor']}
        wanted['sensor'] |= sensor_parameters(stated, topic=request.ports.sensor_topic) or {}
    # Parameters alone name a device when they say where it is; a Net F/T has a usual address.
    named = [
        name
        for name, of_node in wanted.items()
        if 'port' in of_node or of_node.get('sensor') in PORTLESS_SENSORS
    ]
    if not named:
        raise TactileError(
            'name what to check: --sensor, --guide or --tendon with a port, --sensor-topic, '
            '--params with a file that names ports, or --simulated; "tactile devices" lists what '
            'is plugged in'
        )
    checks: list[Callable[[], CheckReport]] = []
    if 'sensor' in named:
        sensor = _make_config(TendonSensorConfig, 'tendon_sensor', wanted['sensor'])
        make: MakeSensor = make_sensor
        if sensor.sensor == 'topic':
            from tactile_lab.commands.force_topics import sensors_on_topics

            make = stack.enter_context(sensors_on_topics(request.namespace))
        checks.append(partial(check_sensor, sensor, request.seconds, make))
    if 'guide' in named:
        guide = _make_config(LinearGuideConfig, 'linear_guide', wanted['guide'])
        checks.append(partial(check_guide, guide, request.may_move))
    if 'tendon' in named:
        tendon = _make_config(TendonActuatorConfig, 'tendon_actuator', wanted['tendon'])
        checks.append(partial(check_tendon, tendon, request.may_move))
    return checks


def _make_config(kind: type[_Config], node: str, parameters: Mapping[str, Any]) -> _Config:
    known = {field.name for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    try:
        # Parameters of ROS itself, QoS overrides for one, are none of the driver's.
        return kind(**{name: value for name, value in parameters.items() if name in known})
    except (TypeError, ValueError) as error:
        raise TactileError(f'parameters of {node}: {error}') from error


def _as_table(report: CheckReport) -> Table:
    table = Table(
        title=escape(f'{report.device} on {report.link}'), title_justify='left', show_header=False
    )
    for name, value in report.facts.items():
        table.add_row(escape(name), escape(str(value)))
    for problem in report.problems:
        table.add_row('[red]WRONG', escape(problem.what))
        if problem.remedy:
            table.add_row('remedy', escape(problem.remedy))
    if not report.problems:
        table.add_row('[green]fit for trials', 'yes')
    return table
