# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The nodes' parameters and the launch files' arguments as Markdown, from the code itself.

``python -m tactile_bringup.launch_config.parameter_tables FILE...`` renews the tables between
the two markers in each file.
"""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from pathlib import Path
import sys
from typing import Any

from linear_guide_driver.records import LinearGuideConfig, TendonActuatorConfig
from tactile_bags.records import PlayerConfig, RecorderConfig
from tactile_bringup.launch_config.launch_arguments import LAUNCH_FILES, LaunchArgument
from tactile_bringup.records import TrialConfig
from tactile_classifier.records import ClassifierConfig
from tactile_features.config import FeatureConfig
from tactile_features.slip import SlipConfig
from tendon_sensor_driver.records import TendonSensorConfig

NODES: dict[str, type] = {
    'tendon_sensor': TendonSensorConfig,
    'linear_guide': LinearGuideConfig,
    'tendon_actuator': TendonActuatorConfig,
    'trial_runner': TrialConfig,
    'tactile_features': FeatureConfig,
    'slip_detector': SlipConfig,
    'tactile_classifier': ClassifierConfig,
    'bag_recorder': RecorderConfig,
    'bag_player': PlayerConfig,
}


def parameter_tables() -> str:
    """Return one table a node: name, default, unit, what values are allowed, meaning.

    A sentence before each table says when the node reads them.
    """
    parts = []
    for node, config_class in NODES.items():
        parts += [
            f'**`{node}`**',
            '',
            _tell_when_read(config_class),
            '',
            '| parameter | default | unit | allowed | meaning |',
            '|---|---|---|---|---|',
            *(_row(field) for field in dataclasses.fields(config_class)),
            '',
        ]
    return '\n'.join(parts)


def _tell_when_read(config_class: type) -> str:
    live = [f'`{f.name}`' for f in dataclasses.fields(config_class) if f.metadata.get('live')]
    if live:
        return f'Live: {", ".join(live)}. The others are read at configure.'
    return 'Live: none. All are read at configure.'


def _row(field: dataclasses.Field[Any]) -> str:
    metadata = field.metadata
    allowed = ''
    if 'range' in metadata:
        low, high = (f'{x:g}' if isinstance(x, float) else str(x) for x in metadata['range'])
        allowed = f'{low} to {high}'
    if metadata.get('choices'):
        allowed = ', '.join(
            f'`{choice}`' if choice else '(empty)' for choice in metadata['choices']
        )
    default = list(field.default) if isinstance(field.default, tuple) else field.default
    shown = f'`{default}`' if default != '' else ''
    unit = metadata.get('unit') or ''
    return f'| `{field.name}` | {shown} | {unit} | {allowed} | {metadata["description"]} |'


def argument_tables() -> str:
    """Return one table a launch file: argument, default, choices, meaning."""
    parts = []
    for name, arguments in LAUNCH_FILES.items():
        parts += [
            f'**`{name}.launch.py`**',
            '',
            '| argument | default | choices | meaning |',
            '|---|---|---|---|',
            *(_argument_row(argument) for argument in arguments),
            '',
        ]
    return '\n'.join(parts)


def _argument_row(argument: LaunchArgument) -> str:
    default = f'`{argument.default}`' if argument.default else ''
    choices = ', '.join(f'`{choice}`' if choice else '(empty)' for choice in argument.choices)
    return f'| `{argument.name}` | {default} | {choices} | {argument.description} |'


TABLES: dict[str, Callable[[], str]] = {
    'parameters': parameter_tables,
    'launch arguments': argument_tables,
}
"""What makes the tables, by what the markers around them say."""


def renew(text: str) -> str:
    """Return ``text`` with fresh tables between each pair of markers.

    Raises
    ------
    ValueError
        When there is none, or one of a pair is missing.
    """
    found = False
    for name, make_tables in TABLES.items():
        begin, end = f'<!-- {name}: begin -->', f'<!-- {name}: end -->'
        if begin not in text and end not in text:
            continue
        head, _, rest = text.partition(begin)
        _, closed, tail = rest.partition(end)
        if not closed:
            raise ValueError(f'the markers {begin} and {end} are not both in the file')
        text = f'{head}{begin}\n{make_tables()}\n{end}{tail}'
        found = True
    if not found:
        raise ValueError(f'no markers of {" or ".join(TABLES)} are in the file')
    return text


if __name__ == '__main__':
    for argument in sys.argv[1:]:
        path = Path(argument)
        path.write_text(renew(path.read_text()))
