# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages to records and back.

``*_from_msg`` read fields by name alone, so that they take rclpy's messages and
those that the rosbags library has deserialised. They raise `MessageError` for what must not be
in such a message, or is not known here.
"""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
import functools
from typing import Any, TypeVar

import numpy as np

from tactile_features.message_checks import (
    END_OF_TIME_NS,
    find_block_fault,
    find_event_fault,
    find_window_fault,
)
from tactile_features.records import FeatureWindow, Measure, Outcome, TrialEvent
from tactile_features.slip import Slip, SlipConfig
from tactile_ros.errors import MessageError
from tactile_ros.strain import StrainBlock, StrainStatus

Record = TypeVar('Record')


def _checked(
    find_fault: Callable[[Record], str],
) -> Callable[[Callable[[Any], Record]], Callable[[Any], Record]]:
    """Make a conversion raise `MessageError` for a record in which ``find_fault`` finds one."""

    def decorate(convert: Callable[[Any], Record]) -> Callable[[Any], Record]:
        @functools.wraps(convert)
        def convert_and_check(msg: Any) -> Record:
            record = convert(msg)
            fault = find_fault(record)
            if fault:
                raise MessageError(fault)
            return record

        return convert_and_check

    return decorate


@_checked(find_block_fault)
def strain_block_from_msg(msg: Any) -> StrainBlock:
    """Return the record of a ``tactile_msgs/StrainBlock``."""
    return StrainBlock(
        stamp_ns=_stamp_from_msg(msg.header.stamp),
        sequence=int(msg.sequence),
        period_ns=int(msg.period_ns),
        tension_n=np.array(msg.tension_n, dtype=np.float64),
        lost_before=int(msg.lost_before),
        status=StrainStatus(int(msg.status)),
        stamp_error_s=float(msg.stamp_error_s),
    )


@_checked(find_block_fault)
def strain_block_from_record(block: StrainBlock) -> StrainBlock:
    """Return a driver's block as its message would come: checked, read-only, without wrench."""
    _check_stamp(block.stamp_ns)
    if block.wrench is None and not block.tension_n.flags.writeable:
        return block
    tension_n = block.tension_n.view()
    tension_n.flags.writeable = False  # others look at it, too
    return dataclasses.replace(block, tension_n=tension_n, wrench=None)


@_checked(find_event_fault)
def event_from_msg(msg: Any) -> TrialEvent:
    """Return the record of a ``tactile_msgs/TrialEvent``."""
    return TrialEvent(
        stamp_ns=_stamp_from_msg(msg.header.stamp),
        trial_id=str(msg.trial_id),
        session_id=str(msg.session_id),
        protocol=str(msg.protocol),
        contact=str(msg.contact),
        object_label=str(msg.object_label),
        phase=str(msg.phase),
        message=str(msg.message),
        glide_speed_m_s=float(msg.glide_speed_m_s),
        simulated=bool(msg.simulated),
        pull_speed_m_s=float(msg.pull_speed_m_s),
        pull_displacement_m=float(msg.pull_displacement_m),
        detected=bool(msg.detected),
        mounting_id=str(msg.mounting_id),
    )


@_checked(find_window_fault)
def feature_window_from_record(window: FeatureWindow) -> FeatureWindow:
    """Return a window of this process as its message would come: checked, and not to change."""
    window.values.flags.writeable = False
    return window


def event_to_msg(event: TrialEvent) -> Any:
    """Return the ``tactile_msgs/TrialEvent`` of a record."""
    from builtin_interfaces.msg import Time
    from std_msgs.msg import Header

    from tactile_msgs.msg import TrialEvent as TrialEventMsg

    fields = dataclasses.asdict(event)
    stamp = Time(**_split_stamp(fields.pop('stamp_ns')))
    return TrialEventMsg(header=Header(stamp=stamp), **fields)


@_checked(find_window_fault)
def feature_window_from_msg(msg: Any) -> FeatureWindow:
    """Return the record of a ``tactile_msgs/TactileFeatures``."""
    return FeatureWindow(
        feature_set=str(msg.feature_set),
        feature_set_version=int(msg.feature_set_version),
        trial_id=str(msg.trial_id),
        contact=str(msg.contact),
        simulated=bool(msg.simulated),
        outcome=_outcome_from_msg(msg.outcome),
        reason=str(msg.reason),
        values=np.array(msg.values, dtype=np.float64),
        window_start_ns=_stamp_from_msg(msg.window_start),
        window_end_ns=_stamp_from_msg(msg.window_end),
        first_sequence=int(msg.first_sequence),
        rate_hz=float(msg.rate_hz),
        sample_count=int(msg.sample_count),
        interpolated_count=int(msg.interpolated_count),
        status=int(msg.status),
        frame_id=str(msg.header.frame_id),
        running=bool(msg.running),
        speed_m_s=float(msg.speed_m_s),
        measures=tuple(
            Measure(
                name=str(m.name),
                unit=str(m.unit),
                value=float(m.value),
                standard_uncertainty=float(m.standard_uncertainty),
                reason=str(m.reason),
            )
            for m in msg.measures
        ),
        specification_digest=str(msg.specification_digest),
        stamp_error_s=float(msg.stamp_error_s),
        session_id=str(msg.session_id),
        object_label=str(msg.object_label),
    )


def feature_window_to_msg(window: FeatureWindow) -> Any:
    """Return the ``tactile_msgs/TactileFeatures`` of a record."""
    from builtin_interfaces.msg import Time
    from std_msgs.msg import Header

    from tactile_msgs.msg import Measure as MeasureMsg
    from tactile_msgs.msg import TactileFeatures

    start = Time(**_split_stamp(window.window_start_ns))
    end = Time(**_split_stamp(window.window_end_ns))
    return TactileFeatures(
        header=Header(stamp=end, frame_id=window.frame_id),
        feature_set=window.feature_set,
        feature_set_version=window.feature_set_version,
        trial_id=window.trial_id,
        contact=window.contact,
        simulated=window.simulated,
        outcome=int(window.outcome),
        reason=window.reason,
        values=window.values.tolist(),
        window_start=start,
        window_end=end,
        first_sequence=window.first_sequence,
        rate_hz=window.rate_hz,
        sample_count=window.sample_count,
        interpolated_count=window.interpolated_count,
        status=window.status,
        running=window.running,
        speed_m_s=window.speed_m_s,
        measures=[
            MeasureMsg(
                name=m.name,
                unit=m.unit,
                defined=not m.reason,
                value=m.value,
                standard_uncertainty=m.standard_uncertainty,
                reason=m.reason,
            )
            for m in window.measures
        ],
        specification_digest=window.specification_digest,
        stamp_error_s=window.stamp_error_s,
        session_id=window.session_id,
        object_label=window.object_label,
    )


def slip_to_msg(slip: Slip, config: SlipConfig, trial_id: str) -> Any:
    """Return the ``tactile_msgs/Slip`` of a record."""
    from builtin_interfaces.msg import Time
    from std_msgs.msg import Header

    from tactile_msgs.msg import Slip as SlipMsg

    return SlipMsg(
        header=Header(
            stamp=Time(**_split_stamp(slip.stamp_ns)),
            frame_id=config.frame_id,
        ),
        motion=slip.motion,
        onset=Time(**_split_stamp(slip.onset_ns)),
        statistic=slip.statistic,
        tension_n=slip.tension_n,
        trial_id=trial_id,
        simulated=config.simulated,
    )


def _outcome_from_msg(value: Any) -> Outcome:
    try:
        return Outcome(int(value))
    except ValueError:
        names = ', '.join(f'{outcome.value} ({outcome.name})' for outcome in Outcome)
        raise MessageError(f'outcome is {value}; it must be one of {names}') from None


def _stamp_from_msg(stamp: Any) -> int:
    return _check_stamp(int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec))


def _check_stamp(stamp_ns: int) -> int:
    if not 0 <= stamp_ns < END_OF_TIME_NS:
        sec, nanosec = divmod(stamp_ns, 1_000_000_000)
        raise MessageError(f'a stamp is {sec} s and {nanosec} ns; it is no ROS time')
    return stamp_ns


def _split_stamp(stamp_ns: int) -> dict[str, int]:
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return {'sec': sec, 'nanosec': nanosec}
