# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""From the text of a description to plain values, and from these to frozen dataclasses.

The text is YAML without what a description has no use for: aliases, tags, merge keys. Plain
scalars are read as YAML 1.2 does, so that ``1e-3`` is a number and ``no`` a word.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import dataclasses
import math
import re
from typing import Any, get_args, get_origin, get_type_hints, TypeVar

import yaml

from tactile_sim.errors import DescriptionError

_T = TypeVar('_T')
_DEEPEST = 8
_LONGEST_SHOWN = 40
_WHOLE = re.compile(r'[-+]?[0-9]{1,18}\Z')
_DECIMAL = re.compile(r'[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]{1,4})?\Z')
_WORDS: dict[str, Any] = {'': None, '~': None, 'null': None, 'true': True, 'false': False}
_WORDS |= {'.inf': math.inf, '-.inf': -math.inf, '.nan': math.nan}


def parse_text(text: str, name: str) -> dict[str, Any]:
    """Read a mapping of names to numbers, words, lists and mappings.

    Raises
    ------
    DescriptionError
        The text is no such mapping; ``name`` is the file named in the sentence.
    """
    try:
        # The events come one by one and without recursion: the depth is ours to limit.
        events = yaml.parse(text, Loader=yaml.SafeLoader)
        values = _read_document(events, name)
    except yaml.MarkedYAMLError as error:
        line = '' if error.problem_mark is None else f' in line {error.problem_mark.line + 1}'
        raise DescriptionError(f'{name} is no YAML{line}: {error.problem}; correct it') from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        # A directive or an escape with a number beyond all bounds.
        reason = ' '.join(str(error).split())
        raise DescriptionError(f'{name} is no YAML: {reason}; correct it') from None
    if not isinstance(values, dict):
        raise DescriptionError(
            f'{name} must be a mapping of names to values; see the packaged one'
        )
    return values


def parse_description(kind: type[_T], values: object, name: str) -> _T:
    """Build one frozen description from plain values.

    Raises
    ------
    DescriptionError
        A key is missing or unknown, or a value is of the wrong kind or out of range.
    """
    if not isinstance(values, Mapping):
        raise DescriptionError(f'{name} must be a mapping of names to values')
    fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    needed = {key for key, field in fields.items() if field.default is dataclasses.MISSING}
    missing, unknown = sorted(needed - set(values)), sorted(set(values) - set(fields))
    if missing or unknown:
        parts = [f'{key} is missing' for key in missing]
        parts += [f'{show(key)} is unknown, known are {", ".join(fields)}' for key in unknown]
        raise DescriptionError(f'{name}: {"; ".join(parts)}')
    hints = get_type_hints(kind)
    built = {
        key: _parse_value(hints[key], value, f'{name}.{key}', fields[key].metadata)
        for key, value in values.items()
    }
    try:
        return kind(**built)
    except DescriptionError as error:
        raise DescriptionError(f'{name}: {error}') from None


def show(value: object) -> str:
    """A value as it may stand in a sentence, however long it is."""
    text = ascii(value)
    return text if len(text) <= _LONGEST_SHOWN else f'{text[:_LONGEST_SHOWN]}...'


def _read_document(events: Iterator[yaml.Event], name: str) -> Any:
    for event in events:
        if isinstance(event, yaml.NodeEvent):
            break
    else:
        return None
    values = _read_node(events, event, name, 0)
    if any(isinstance(event, yaml.DocumentStartEvent) for event in events):
        raise DescriptionError(f'{name} has more than one document; remove the lines ---')
    return values


def _read_node(events: Iterator[yaml.Event], event: yaml.Event, where: str, depth: int) -> Any:
    if isinstance(event, yaml.AliasEvent):
        raise DescriptionError(f'{where} is the alias *{event.anchor}; write the value itself')
    if isinstance(event, yaml.ScalarEvent | yaml.CollectionStartEvent) and event.tag is not None:
        raise DescriptionError(f'{where} has the tag {show(event.tag)}; write the value alone')
    if isinstance(event, yaml.ScalarEvent):
        return _read_scalar(event.value) if event.implicit[0] else event.value
    if depth == _DEEPEST:
        raise DescriptionError(f'{where} is nested too deeply; see the packaged descriptions')
    if isinstance(event, yaml.SequenceStartEvent):
        return _read_sequence(events, where, depth)
    return _read_mapping(events, where, depth)


def _read_sequence(events: Iterator[yaml.Event], where: str, depth: int) -> list[Any]:
    values: list[Any] = []
    while not isinstance(event := next(events), yaml.SequenceEndEvent):
        values.append(_read_node(events, event, f'{where}[{len(values)}]', depth + 1))
    return values


def _read_mapping(events: Iterator[yaml.Event], where: str, depth: int) -> dict[str, Any]:
    values: dict[str, Any] = {}
    while not isinstance(event := next(events), yaml.MappingEndEvent):
        if not isinstance(event, yaml.ScalarEvent):
            raise DescriptionError(f'{where} has a key that is no word; write name: value')
        key = event.value
        if key in values:
            raise DescriptionError(f'{where} has {show(key)} twice; remove one')
        shown = key if key.isidentifier() and len(key) <= _LONGEST_SHOWN else show(key)
        inner = f'{where}: {shown}' if depth == 0 else f'{where}.{shown}'
        values[key] = _read_node(events, next(events), inner, depth + 1)
    return values


def _read_scalar(text: str) -> Any:
    if text in _WORDS:
        return _WORDS[text]
    if _WHOLE.match(text):
        return int(text)
    return float(text) if _DECIMAL.match(text) else text


def _parse_value(wanted: Any, value: object, where: str, limits: Mapping[str, Any]) -> Any:
    if dataclasses.is_dataclass(wanted):
        return parse_description(wanted, value, where)  # type: ignore[arg-type]
    if get_origin(wanted) is tuple:
        return _parse_list(get_args(wanted), value, where)
    if wanted is str:
        if not isinstance(value, str):
            raise DescriptionError(f'{where} is {show(value)}; it must be a word')
        return value
    return _parse_number(wanted, value, where, limits)


def _parse_list(kinds: tuple[Any, ...], value: object, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise DescriptionError(f'{where} is {show(value)}; it must be a list, such as []')
    if kinds[1:] == (...,):
        kinds = (kinds[0],) * len(value)
    elif len(value) != len(kinds):
        raise DescriptionError(f'{where} has {len(value)} entries; it must have {len(kinds)}')
    pairs = zip(kinds, value, strict=True)
    return tuple(_parse_value(kind, v, f'{where}[{i}]', {}) for i, (kind, v) in enumerate(pairs))


def _parse_number(wanted: type, value: object, where: str, limits: Mapping[str, Any]) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise DescriptionError(f'{where} is {show(value)}; it must be a finite number')
    if wanted is int and not isinstance(value, int):
        raise DescriptionError(f'{where} is {value!r}; it must be a whole number')
    above, low, high = limits.get('above'), limits.get('from'), limits.get('to')
    if (
        (above is not None and value <= above)
        or (low is not None and value < low)
        or (high is not None and value > high)
    ):
        bottom = f'at least {low:g}' if above is None else f'above {above:g}'
        raise DescriptionError(f'{where} is {value:g}; it must be {bottom} and at most {high:g}')
    return value if wanted is int else float(value)
