# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks of received messages: values that are impossible or not known here are refused."""

from __future__ import annotations

import math

import numpy as np

from tactile_features import records
from tactile_features.records import FeatureWindow, TrialEvent
from tactile_ros.errors import MessageError
from tactile_ros.strain import StrainBlock, StrainStatus

LARGEST_TENSION_N = 1e9
"""A larger value is no tension of anything. Values that are not finite are the core's part."""

END_OF_TIME_NS = 2**31 * 10**9
"""Times in messages lie before this [ns]."""

_KNOWN = {
    name: tuple(value for key, value in vars(records).items() if key.startswith(name))
    for name in ('PHASE_', 'CONTACT_', 'PROTOCOL_')
}
_STATUS = int(sum(StrainStatus))


def check_stamp(stamp_ns: int) -> int:
    """Return a time; raise `MessageError` when it is no ROS time."""
    if not 0 <= stamp_ns < END_OF_TIME_NS:
        sec, nanosec = divmod(stamp_ns, 1_000_000_000)
        raise MessageError(f'a stamp is {sec} s and {nanosec} ns; it is no ROS time')
    return stamp_ns


def check_block(block: StrainBlock) -> StrainBlock:
    """Return a block; raise `MessageError` when something in it is wrong."""
    count = len(block.tension_n)
    if not count:
        raise MessageError('tension_n is empty; a block holds one sample or more')
    period_ns = block.period_ns
    if period_ns < 0 or (period_ns == 0 and count > 1):
        raise MessageError(f'period_ns is {period_ns}; it must be positive')
    if block.stamp_ns + (count - 1) * period_ns >= END_OF_TIME_NS:
        raise MessageError(
            f'period_ns is {period_ns}; the last sample lies beyond the end of ROS time'
        )
    if block.sequence + count > 2**64:
        raise MessageError(
            f'sequence is {block.sequence}; its {count} samples do not fit into 64 bits'
        )
    largest_n = abs(block.tension_n[0]) if count == 1 else np.abs(block.tension_n).max()
    if not largest_n <= LARGEST_TENSION_N:  # or one is not a number
        finite = block.tension_n[np.isfinite(block.tension_n)]
        beyond = finite[np.abs(finite) > LARGEST_TENSION_N]
        if len(beyond):
            raise MessageError(
                f'tension_n holds {beyond[0]:g}; no tension is larger than {LARGEST_TENSION_N:g} N'
            )
    _check_status(block.status)
    if not math.isfinite(block.stamp_error_s):
        raise MessageError(f'stamp_error_s is {block.stamp_error_s}; it must be finite')
    return block


def check_event(event: TrialEvent) -> TrialEvent:
    """Return an event; raise `MessageError` when something in it is wrong."""
    _check_name('phase', event.phase, _KNOWN['PHASE_'])
    _check_name('contact', event.contact, ('', *_KNOWN['CONTACT_']))
    _check_name('protocol', event.protocol, ('', *_KNOWN['PROTOCOL_']))
    _check_floats(event)
    return event


def check_window(window: FeatureWindow) -> FeatureWindow:
    """Return a window; raise `MessageError` when something in it is wrong.

    A feature set that is not known here is no fault: it is one for other nodes.
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
        raise MessageError(f'status is {status}; its bits {unknown} are not known here')


def _check_floats(record: object) -> None:
    for name, value in vars(record).items():
        if isinstance(value, float) and not math.isfinite(value):
            raise MessageError(f'{name} is {value}; it must be finite')
