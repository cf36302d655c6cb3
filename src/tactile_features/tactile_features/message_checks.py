# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What messages must hold, so that what is computed from them is what their sender meant."""

from __future__ import annotations

import math

import numpy as np

from tactile_features import records
from tactile_features.records import FeatureWindow, TrialEvent
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


def find_block_fault(block: StrainBlock) -> str:
    """Return what is wrong with a block; empty when nothing is."""
    count = len(block.tension_n)
    if not count:
        return 'tension_n is empty; a block holds one sample or more'
    if block.period_ns < 0 or (block.period_ns == 0 and count > 1):
        return f'period_ns is {block.period_ns}; it must be positive'
    if block.stamp_ns + (count - 1) * block.period_ns >= END_OF_TIME_NS:
        return f'period_ns is {block.period_ns}; the last sample lies beyond the end of ROS time'
    if block.sequence + count > 2**64:
        return f'sequence is {block.sequence}; its {count} samples do not fit into 64 bits'
    largest_n = abs(block.tension_n[0]) if count == 1 else np.abs(block.tension_n).max()
    if not largest_n <= LARGEST_TENSION_N:  # or one is not a number
        finite = block.tension_n[np.isfinite(block.tension_n)]
        beyond = finite[np.abs(finite) > LARGEST_TENSION_N]
        if len(beyond):
            return (
                f'tension_n holds {beyond[0]:g}; no tension is larger than {LARGEST_TENSION_N:g} N'
            )
    return _find_status_fault(block.status) or _find_float_fault(block)


def find_event_fault(event: TrialEvent) -> str:
    """Return what is wrong with an event; empty when nothing is."""
    return (
        _find_name_fault('phase', event.phase, _KNOWN['PHASE_'])
        or _find_name_fault('contact', event.contact, ('', *_KNOWN['CONTACT_']))
        or _find_name_fault('protocol', event.protocol, ('', *_KNOWN['PROTOCOL_']))
        or _find_float_fault(event)
    )


def find_window_fault(window: FeatureWindow) -> str:
    """Return what is wrong with a window; empty when nothing is.

    A feature set that is not known here is no fault: it is one for other nodes.
    """
    return (
        _find_name_fault('contact', window.contact, ('', *_KNOWN['CONTACT_']))
        or _find_status_fault(window.status)
        or _find_float_fault(window)
    )


def _find_name_fault(field: str, value: str, known: tuple[str, ...]) -> str:
    if value in known:
        return ''
    names = ', '.join(name or '(empty)' for name in known)
    return f'{field} is "{value}"; it must be one of {names}'


def _find_status_fault(status: int) -> str:
    unknown = int(status) & ~_STATUS
    return f'status is {status}; its bits {unknown} are not known here' if unknown else ''


def _find_float_fault(record: object) -> str:
    for name, value in vars(record).items():
        if isinstance(value, float) and not math.isfinite(value):
            return f'{name} is {value}; it must be finite'
    return ''
