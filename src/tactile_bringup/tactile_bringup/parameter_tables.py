# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parameters of every node as Markdown, from the Config classes themselves.

``python -m tactile_bringup.parameter_tables README.md`` renews the tables between
the two markers in a file.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

from linear_guide_driver.records import LinearGuideConfig, TendonActuatorConfig
from tactile_bringup.records import RecorderConfig, TrialConfig
from tactile_classifier.records import ClassifierConfig
from tactile_features.records import FeatureConfig
from tendon_sensor_driver.records import TendonSensorConfig

NODES: dict[str, type] = {
    'tendon_sensor': TendonSensorConfig,
    'linear_guide': LinearGuideConfig,
    'tendon_actuator': TendonActuatorConfig,
    'trial_runner': TrialConfig,
    'tactile_features': FeatureConfig,
    'tactile_classifier': ClassifierConfig,
    'bag_recorder': RecorderConfig,
}

BEGIN = '<!-- parameters: begin -->'
END = '<!-- parameters: end -->'


def parameter_tables() -> str:
    """Return one table a node: name, default, unit, what values are allowed, meaning."""
    parts = []
    for node, config_class in NODES.items():
        parts += [
            f'**`{node}`**',
            '',
            '| parameter | default | unit | allowed | meaning |',
            '|---|---|---|---|---|',
            *(_row(field) for field in dataclasses.fields(config_class)),
            '',
        ]
    return '\n'.join(parts)


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


def renew(text: str) -> str:
    """Return ``text`` with fresh tables between the markers.

    Raises
    ------
    ValueError
        When a marker is missing.
    """
    head, found, rest = text.partition(BEGIN)
    _, closed, tail = rest.partition(END)
    if not found or not closed:
        raise ValueError(f'the markers {BEGIN} and {END} are not in the file')
    return f'{head}{BEGIN}\n{parameter_tables()}\n{END}{tail}'


if __name__ == '__main__':
    path = Path(sys.argv[1])
    path.write_text(renew(path.read_text()))
