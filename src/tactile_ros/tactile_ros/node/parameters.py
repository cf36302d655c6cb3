# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS parameters from the frozen Config class of a core module.

A Config is a dataclass without any ROS in it; `tactile_ros.configs.parameter` makes its fields.
The parameter has the field's name, type and default, so that YAML, code and documentation cannot
disagree. An integer is taken where a float is wanted.

A node reads its Config when it is configured. Until it is cleaned up, a change is refused. A
field with the metadata ``live`` (True) can be set at any time: its node looks at the
parameter whenever it needs it.
"""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from tactile_ros.configs import find_objection
from tactile_ros.rclpy_internals import parameter_overrides

Config = TypeVar('Config')

REMEDY = 'deactivate and clean up the node first'


def describe_field(field: dataclasses.Field[Any]) -> ParameterDescriptor:
    """Return the descriptor of the parameter that stands for one Config field."""
    metadata = field.metadata
    text = metadata['description']
    if metadata.get('unit'):
        text += f' [{metadata["unit"]}]'
    if metadata.get('choices'):
        text += f'; one of {", ".join(map(str, metadata["choices"]))}'
    descriptor = ParameterDescriptor(name=field.name, description=text)
    if not metadata.get('live'):
        descriptor.additional_constraints = f'read when the node is configured; {REMEDY}'
    if 'range' in metadata:
        low, high = metadata['range']
        if isinstance(field.default, float):
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high))
            ]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    return descriptor


def declare_config(node: Node, config_class: type[Config]) -> None:
    """Declare a parameter for every field of ``config_class``.

    While the node's ``is_configured`` is true, only fields that are live can change.

    Raises
    ------
    rclpy.exceptions.InvalidParameterValueException
        When an override is out of range or of the wrong type.
    """
    for field in dataclasses.fields(config_class):  # type: ignore[arg-type]
        default = list(field.default) if isinstance(field.default, tuple) else field.default
        if default == []:
            is_integer = field.metadata.get('element') is int
            types = Parameter.Type
            default = types.INTEGER_ARRAY if is_integer else types.STRING_ARRAY
        overrides = parameter_overrides(node)
        if field.name in overrides:
            overrides[field.name] = _with_float(field, overrides[field.name])
        node.declare_parameter(field.name, default, describe_field(field))

    fields = {f.name: f for f in dataclasses.fields(config_class)}  # type: ignore[arg-type]

    def convert(parameters: list[Parameter]) -> list[Parameter]:
        return [_with_float(fields[p.name], p) if p.name in fields else p for p in parameters]

    node.add_pre_set_parameters_callback(convert)

    def check(parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            field = fields.get(parameter.name)
            reason = _find_objection(node, field, parameter) if field else ''
            if reason:
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)


def _with_float(field: dataclasses.Field[Any], parameter: Parameter) -> Parameter:
    """Return the parameter; an integer becomes a float where the field is one."""
    if isinstance(field.default, float) and parameter.type_ == Parameter.Type.INTEGER:
        return Parameter(parameter.name, value=float(parameter.value))
    return parameter


def _find_objection(node: Node, field: dataclasses.Field[Any], parameter: Parameter) -> str:
    """Return why a parameter cannot take a value; empty when it can."""
    if objection := find_objection(field, parameter.value):
        return objection
    if not node.is_configured or field.metadata.get('live'):
        return ''
    # A file of parameters may be loaded again: what it does not change is no change.
    present = node.get_parameter_or(field.name, None)
    if present is not None and present.get_parameter_value() == parameter.get_parameter_value():
        return ''
    return f'{parameter.name} is read when the node is configured: {REMEDY}'


def read_config(node: Node, config_class: type[Config]) -> Config:
    """Return a Config that holds the parameters' present values.

    Raises
    ------
    ValueError
        When a value is not one of the field's choices, or whatever the Config's
        own ``__post_init__`` refuses.
    """
    values = {}
    for field in dataclasses.fields(config_class):  # type: ignore[arg-type]
        value: Any = node.get_parameter_or(field.name, None)
        value = field.default if value is None or value.value is None else value.value
        if isinstance(field.default, tuple):
            value = tuple(value)
        if objection := find_objection(field, value):
            raise ValueError(objection)
        values[field.name] = value
    return config_class(**values)
