# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Conversion of ROS messages to records and back.

The functions ``*_from_msg`` read fields by name only. They therefore accept messages of rclpy and
messages that the rosbags library deserialised. If a message has invalid or unknown values, they
raise `MessageError`.
"""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np

from tactile_features import types
from tactile_features.errors import FeatureError
from tactile_features.spec import FeatureSpec, FeatureSpecifications
from tactile_features.types import FeatureWindow, TrialEvent, WindowOutcome
from tactile_ros.errors import MessageError
from tactile_ros.message_classes import (
    copy_fields,
    enum_from_msg,
    header_to_msg,
    time_from_msg,
    time_to_msg,
)
from tactile_ros.strain import StrainBlock, StrainStatus

LARGEST_TENSION_N = 1e9
"""Larger tensions in a message are rejected [N]. Non-finite values are left to the extractor."""

END_OF_TIME_NS = 2**31 * 10**9
"""Times in messages must lie before this [ns]."""

_KNOWN = {
    name: tuple(value for key, value in vars(types).items() if key.startswith(name))
    for name in ('PHASE_', 'CONTACT_', 'PROTOCOL_')
}
_STATUS = int(sum(StrainStatus))


def check_stamp(stamp_ns: int) -> int:
    """Return the time [ns]; raise `MessageError` if it is not a valid ROS time."""
    if not 0 <= stamp_ns < END_OF_TIME_NS:
        sec, nanosec = divmod(stamp_ns, 1_000_000_000)
        raise MessageError(f'a stamp is {sec} s and {nanosec} ns, which is not a valid ROS time')
    return stamp_ns


def check_block(block: StrainBlock) -> StrainBlock:
    """Return the block; raise `MessageError` if one of its values is invalid."""
    check_stamp(block.stamp_ns)
    count = len(block.tension_n)
    if not count:
        raise MessageError('tension_n is empty; a block must hold at least one sample')
    period_ns = block.period_ns
    if period_ns < 0 or (period_ns == 0 and count > 1):
        raise MessageError(f'period_ns is {period_ns}; it must be positive')
    if block.stamp_ns + (count - 1) * period_ns >= END_OF_TIME_NS:
        raise MessageError(
            f'period_ns is {period_ns}; the stamp of the last sample exceeds the range of ROS time'
        )
    if block.sequence + count > 2**64:
        raise MessageError(
            f'sequence is {block.sequence}; its {count} samples do not fit into 64 bits'
        )
    largest_n = abs(block.tension_n[0]) if count == 1 else np.abs(block.tension_n).max()
    if not largest_n <= LARGEST_TENSION_N:  # also true for NaN
        finite = block.tension_n[np.isfinite(block.tension_n)]
        beyond = finite[np.abs(finite) > LARGEST_TENSION_N]
        if len(beyond):
            raise MessageError(
                f'tension_n holds {beyond[0]:g}; no tension is larger than {LARGEST_TENSION_N:g} N'
            )
    if int(block.status) & ~_STATUS:
        _check_status(block.status)
    if not math.isfinite(block.stamp_error_s):
        raise MessageError(f'stamp_error_s is {block.stamp_error_s}; it must be finite')
    return block


def check_window(window: FeatureWindow) -> FeatureWindow:
    """Return the window; raise `MessageError` if one of its values is invalid.

    An unknown feature set is not an error, because the window may be meant for another node.
    """
    _check_name('contact', window.contact, ('', *_KNOWN['CONTACT_']))
    _check_status(window.status)
    _check_floats(window)
    return window


def _check_name(field: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        names = ', '.join(name or '(empty)' for name in known)
        raise MessageError(f'{field} is "{value}"; it must be one of {names}')


def _check_status(status: int) -> None:
    if unknown := int(status) & ~_STATUS:
        raise MessageError(f'status is {status}; its bits {unknown} are unknown')


def _check_floats(record: object) -> None:
    for name, value in vars(record).items():
        if isinstance(value, float) and not math.isfinite(value):
            raise MessageError(f'{name} is {value}; it must be finite')


def strain_block_from_msg(msg: Any) -> StrainBlock:
    """Return the record of a ``tactile_msgs/StrainBlock``."""
    return check_block(
        StrainBlock(
            stamp_ns=time_from_msg(msg.header.stamp),
            sequence=int(msg.sequence),
            period_ns=int(msg.period_ns),
            tension_n=np.array(msg.tension_n, dtype=np.float64),
            lost_before=int(msg.lost_before),
            status=StrainStatus(int(msg.status)),
            stamp_error_s=float(msg.stamp_error_s),
        )
    )


def check_record(block: StrainBlock) -> StrainBlock:
    """Check a block of a driver; return it read-only and without wrench, like a received block."""
    if block.wrench is not None or block.tension_n.flags.writeable:
        tension_n = block.tension_n.view()
        tension_n.flags.writeable = False  # other stages share the array
        block = dataclasses.replace(block, tension_n=tension_n, wrench=None)
    return check_block(block)


def event_from_msg(msg: Any) -> TrialEvent:
    """Return the record of a ``tactile_msgs/TrialEvent``."""
    event: TrialEvent = copy_fields(msg, TrialEvent, stamp_ns=_stamp_from_msg(msg.header.stamp))
    _check_name('phase', event.phase, _KNOWN['PHASE_'])
    _check_name('contact', event.contact, ('', *_KNOWN['CONTACT_']))
    _check_name('protocol', event.protocol, ('', *_KNOWN['PROTOCOL_']))
    _check_floats(event)
    return event


def feature_window_from_record(window: FeatureWindow) -> FeatureWindow:
    """Check a window and make its values read-only, like those of a received window."""
    window.values.flags.writeable = False
    return check_window(window)


def event_to_msg(event: TrialEvent) -> Any:
    """Return the ``tactile_msgs/TrialEvent`` of a record."""
    from tactile_msgs.msg import TrialEvent as TrialEventMsg

    fields = dataclasses.asdict(event)
    return TrialEventMsg(header=header_to_msg(fields.pop('stamp_ns')), **fields)


def feature_window_from_msg(msg: Any) -> FeatureWindow:
    """Return the record of a ``tactile_msgs/TactileFeatures``."""
    return check_window(
        copy_fields(
            msg,
            FeatureWindow,
            outcome=enum_from_msg(WindowOutcome, 'outcome', msg.outcome),
            values=np.array(msg.values, dtype=np.float64),
            window_start_ns=_stamp_from_msg(msg.window_start),
            window_end_ns=_stamp_from_msg(msg.window_end),
            frame_id=msg.header.frame_id,
        )
    )


def feature_window_to_msg(window: FeatureWindow) -> Any:
    """Return the ``tactile_msgs/TactileFeatures`` of a record."""
    from tactile_msgs.msg import TactileFeatures

    fields = dataclasses.asdict(window)
    end_ns = fields.pop('window_end_ns')
    return TactileFeatures(
        header=header_to_msg(end_ns, fields.pop('frame_id')),
        window_start=time_to_msg(fields.pop('window_start_ns')),
        window_end=time_to_msg(end_ns),
        outcome=int(fields.pop('outcome')),
        values=fields.pop('values').tolist(),
        **fields,
    )


def specifications_to_msg(announced: FeatureSpecifications) -> Any:
    """Return the ``tactile_msgs/FeatureSpecifications`` of a record."""
    from tactile_msgs.msg import FeatureSpecification
    from tactile_msgs.msg import FeatureSpecifications as FeatureSpecificationsMsg

    def to_msg(spec: FeatureSpec) -> Any:
        return FeatureSpecification(
            digest=spec.digest,
            task=spec.task,
            feature_set=spec.feature_set,
            version=spec.version,
            rate_hz=spec.rate_hz,
            sample_count=spec.sample_count,
            names=list(spec.names),
            units=list(spec.units),
            parameter_names=list(spec.parameters),
            parameter_values=[json.dumps(value) for value in spec.parameters.values()],
        )

    return FeatureSpecificationsMsg(
        header=header_to_msg(announced.stamp_ns),
        specifications=[to_msg(spec) for spec in announced.specs],
        config=json.dumps(dict(announced.config)),
    )


def specifications_from_msg(msg: Any) -> FeatureSpecifications:
    """Return the record of a ``tactile_msgs/FeatureSpecifications``.

    The digest of each specification must match its content.
    """
    config = _from_json('config', msg.config)
    if not isinstance(config, dict):
        raise MessageError('config is not a JSON object that maps parameter names to values')
    specs = tuple(_spec_from_msg(entry) for entry in msg.specifications)
    return FeatureSpecifications(specs, config, _stamp_from_msg(msg.header.stamp))


def _spec_from_msg(msg: Any) -> FeatureSpec:
    names, values = list(msg.parameter_names), list(msg.parameter_values)
    if len(names) != len(values):
        raise MessageError(
            f'parameter_values has {len(values)} entries and parameter_names {len(names)}; '
            'both must have the same length'
        )
    fields = {
        field.name: getattr(msg, field.name)
        for field in dataclasses.fields(FeatureSpec)
        if hasattr(msg, field.name)  # the message has no channels
    }
    fields['parameters'] = {
        name: _from_json(name, value) for name, value in zip(names, values, strict=True)
    }
    try:
        spec = FeatureSpec.from_dict(fields)
    except FeatureError as error:
        raise MessageError(str(error)) from error
    if spec.digest != msg.digest:
        raise MessageError(
            f'digest is {msg.digest}, but the specification of {spec.feature_set} has the digest '
            f'{spec.digest}: one of them was changed'
        )
    return spec


def _from_json(field: str, text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MessageError(f'{field} is not JSON: {error}') from error


def _stamp_from_msg(stamp: Any) -> int:
    return check_stamp(time_from_msg(stamp))
