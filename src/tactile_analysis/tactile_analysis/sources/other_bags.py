# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials from bags of other software: each bag is one trial, read from one topic with a force."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.options import SourceError, SourceOptions
from tactile_analysis.sources.files import ambiguity, ImportNotes, name_labels, SourceFile
from tactile_analysis.sources.signals import make_trial
from tactile_bags.bag_reader import TactileBag
from tactile_bags.trial import Trial
from tactile_ros.message_classes import time_from_msg
from tactile_ros.topics import JOINT_STATE, STRAIN, WRENCH

FLOATS = ('std_msgs/msg/Float64', 'std_msgs/msg/Float32')
TYPES = (WRENCH, *FLOATS, JOINT_STATE, STRAIN)
"""Message types that contain a force."""

_AXES = ('x', 'y', 'z', 'norm')
_WRENCH_FIELDS = tuple(f'{part}.{axis}' for part in ('force', 'torque') for axis in _AXES)


def read_bag_trials(
    leaves: Sequence[SourceFile], options: SourceOptions, notes: ImportNotes
) -> list[Trial]:
    """Read bags with one trial each.

    Times are the stamps in the headers of the messages, or arrival times for messages without a
    header.
    """
    named = name_labels(leaves, options, notes)
    topic, fields = options.topic, [f.strip() for f in options.field.split(',') if f.strip()]
    trials = []
    for leaf, columns in zip(leaves, named, strict=True):
        with TactileBag(leaf.path, needs_strain=False) as bag:
            topic = topic or _choose_topic(bag)
            found = bag.topics.get(topic)
            if found is None or found[0] not in TYPES:
                raise SourceError(
                    f'{leaf.path} has no topic {topic} of a supported type; it has: '
                    f'{_format_topics(bag)}'
                )
            of_topic = [m for m in bag.messages(found[0]) if m.topic == topic]
            messages = [m.decode() for m in of_topic]
            received = [m.received_at_ns for m in of_topic]
        if not messages:
            raise SourceError(f'{leaf.path}: there are no messages on {topic}')
        fields = fields or _choose_fields(found[0], messages[0])
        values, stamps_ns = _read_fields(leaf, found[0], fields, messages, received)
        if found[0] != STRAIN and not all(map(_header_ns, messages)):
            notes.add(f'time: the arrival of messages on {topic} that have no stamp')
        values, stamps_ns = _put_in_order(values, stamps_ns, notes)
        time_s = (stamps_ns - stamps_ns[0]) * 1e-9
        known = {**columns, 'source': leaf.name}
        units = tuple(_unit(found[0], field) for field in fields)
        trials.append(
            make_trial(
                leaf.name,
                values,
                time_s,
                known,
                options,
                notes,
                channels=tuple(fields),
                units=units,
            )
        )
    notes.add(f'used {", ".join(fields)} of the messages on {topic}; each bag is one trial')
    return trials


def _format_topics(bag: TactileBag) -> str:
    return ', '.join(f'{name} ({kind})' for name, (kind, _) in sorted(bag.topics.items()))


def _choose_topic(bag: TactileBag) -> str:
    found = [name for name, (kind, count) in sorted(bag.topics.items()) if kind in TYPES and count]
    if not found:
        raise SourceError(
            f'{bag.path} has no messages with a force ({", ".join(TYPES)}); it has: '
            f'{_format_topics(bag)}'
        )
    if len(found) == 1:
        return str(found[0])
    raise ambiguity(
        f'{bag.path} has several topics with a force', found, '--topic NAME', with_layout=False
    )


def _choose_fields(type_name: str, message: Any) -> list[str]:
    if type_name in FLOATS:
        return ['data']
    if type_name == STRAIN:
        return ['tension_n']
    choices = _WRENCH_FIELDS
    if type_name == JOINT_STATE:
        choices = tuple(f'effort.{name}' for name in message.name)
        if len(choices) == 1:
            return list(choices)
    raise ambiguity(
        f'the field of {type_name} with the signal is unknown',
        choices,
        '--field NAME[,NAME...]',
        with_layout=False,
    )


def _read_fields(
    leaf: SourceFile,
    type_name: str,
    fields: Sequence[str],
    messages: Sequence[Any],
    received_ns: Sequence[int],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the values of the fields, shape (channels, samples), and their stamps [ns]."""
    if type_name == STRAIN:
        if list(fields) != ['tension_n']:
            raise SourceError(f'--field: {type_name} has tension_n')
        values = np.concatenate([np.asarray(m.tension_n, dtype=np.float64) for m in messages])
        stamps = [
            _header_ns(m) + i * int(m.period_ns) for m in messages for i in range(len(m.tension_n))
        ]
        return values[np.newaxis], np.array(stamps, dtype=np.int64)
    readers = [_find_reader(type_name, name) for name in fields]
    try:
        rows = [[read(message) for message in messages] for read in readers]
    except (ValueError, IndexError) as error:
        joints = ', '.join(getattr(messages[0], 'name', ()))
        raise SourceError(
            f'--field: {leaf.path} has no {", ".join(fields)} in each message; its joints are '
            f'{joints}'
        ) from error
    stamps = [_header_ns(m) or at for m, at in zip(messages, received_ns, strict=True)]
    return np.array(rows, dtype=np.float64), np.array(stamps, dtype=np.int64)


def _header_ns(message: Any) -> int:
    """Return the stamp in the header of a message [ns]; 0 if it has none."""
    header = getattr(message, 'header', None)
    return 0 if header is None else time_from_msg(header.stamp)


def _unit(type_name: str, field: str) -> str:
    """Return the unit that a message type defines for a field; empty if it defines none."""
    if type_name == STRAIN:
        return 'N'
    if type_name != WRENCH:
        return ''
    return 'N' if field.removeprefix('wrench.').startswith('force') else 'N m'


def _find_reader(type_name: str, field: str) -> Callable[[Any], float]:
    part, _, rest = field.removeprefix('wrench.').partition('.')
    if type_name in FLOATS and field == 'data':
        return lambda message: float(message.data)
    if type_name == JOINT_STATE and part in ('effort', 'position', 'velocity') and rest:
        return lambda message: float(getattr(message, part)[list(message.name).index(rest)])
    if type_name == WRENCH and part in ('force', 'torque') and rest in _AXES:
        if rest == 'norm':
            return lambda message: math.hypot(
                *(getattr(getattr(message.wrench, part), axis) for axis in 'xyz')
            )
        return lambda message: float(getattr(getattr(message.wrench, part), rest))
    known = {WRENCH: ', '.join(_WRENCH_FIELDS), JOINT_STATE: 'effort.JOINT'}.get(type_name, 'data')
    raise SourceError(f'--field: {type_name} has no "{field}"; it has {known}')


def _put_in_order(
    values: NDArray[np.float64], stamps_ns: NDArray[np.int64], notes: ImportNotes
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return samples sorted by their stamps, without repeated stamps."""
    in_order, first = np.unique(stamps_ns, return_index=True)
    if len(in_order) < len(stamps_ns):
        notes.add('messages with repeated stamps were ignored, except the first one')
    if (np.diff(first) < 0).any():
        notes.add('messages out of order were sorted by their stamps')
    return values[:, first], in_order
