# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Records to ROS messages, and health to diagnostics."""

from __future__ import annotations

import array
import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_ros.message_classes import time_to_msg
from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.records import AXES, Health, TendonSensorConfig
from tendon_sensor_driver.tare import Bias

LEVEL_OK, LEVEL_WARN, LEVEL_ERROR = 0, 1, 2
"""The levels of ``diagnostic_msgs/DiagnosticStatus``."""


def to_strain_msg(block: StrainBlock, frame_id: str) -> Any:
    """Return the block as ``tactile_msgs/StrainBlock``."""
    from tactile_msgs.msg import StrainBlock as StrainBlockMsg

    message = StrainBlockMsg()
    message.header.stamp = time_to_msg(block.stamp_ns)
    message.header.frame_id = frame_id
    message.sequence = block.sequence
    message.period_ns = block.period_ns
    # A list would be checked number by number.
    message.tension_n = array.array('d', block.tension_n.tobytes())
    message.lost_before = block.lost_before
    message.stamp_error_s = block.stamp_error_s
    message.status = int(block.status)
    return message


def to_wrench_msg(block: StrainBlock, frame_id: str, axis: str = 'fx', scale: float = 1.0) -> Any:
    """Return the block's last sample as ``geometry_msgs/WrenchStamped``, the tension along +x.

    A wrench of six axes is turned from the sensor's own axes into the frame, whose +x lies
    along ``axis``, against it where ``scale`` is negative. The type has no status: a
    saturated value is published as it is.
    """
    from geometry_msgs.msg import WrenchStamped

    last = len(block.tension_n) - 1
    message = WrenchStamped()
    message.header.stamp = time_to_msg(block.stamp_ns + last * block.period_ns)
    message.header.frame_id = frame_id
    if block.wrench is None:
        message.wrench.force.x = float(block.tension_n[last])
        return message
    wrench = turn_wrench(block.wrench[last], axis, scale)
    force, torque = message.wrench.force, message.wrench.torque
    force.x, force.y, force.z, torque.x, torque.y, torque.z = wrench.tolist()
    return message


def turn_wrench(wrench: NDArray[np.float64], axis: str, scale: float) -> NDArray[np.float64]:
    """Return a wrench in the frame whose +x is ``axis``, or its opposite for a negative scale.

    The other two axes follow in their cyclic order; for the opposite the frame is turned half
    a turn about its second axis, so that it stays right-handed. The wrench has shape (6,), in the
    sensor's own axes [N, N m].
    """
    first = AXES.index(axis) % 3
    order = [(first + i) % 3 for i in range(3)]
    turned: NDArray[np.float64] = wrench[order + [3 + i for i in order]]
    if scale < 0:
        turned = turned * np.array([-1.0, 1.0, -1.0, -1.0, 1.0, -1.0])
    return turned


def to_tare_msg(bias: Bias, frame_id: str) -> Any:
    """Return the bias as ``tactile_msgs/Tare``."""
    from tactile_msgs.msg import Tare

    message = Tare()
    message.header.stamp = time_to_msg(bias.stamp_ns)
    message.header.frame_id = frame_id
    message.is_set = bias.samples > 0
    message.bias_n = bias.bias_n
    message.spread_n = bias.spread_n
    message.samples = bias.samples
    return message


def assess_health(
    health: Health, before: Health, config: TendonSensorConfig, now_ns: int
) -> tuple[int, str]:
    """Return a level and a sentence that say how the link does.

    What has been counted since ``before``, some time ago, is news. ``now_ns`` is on the clock of
    the client [ns].
    """
    if not health.is_connected:
        what = 'no samples' if config.sensor == 'topic' else 'link down, reconnecting'
        return LEVEL_ERROR, f'{what}: {health.last_error}'
    silence_s = (now_ns - health.heard_at_ns) / 1e9
    if silence_s > config.silence_s:
        return LEVEL_WARN, _format_silence(silence_s, health, before, config)
    if health.device_status or health.status & StrainStatus.DEVICE_ERROR:
        return LEVEL_ERROR, f'the device reports: {health.device_status or "an error"}'
    if health.status & StrainStatus.SATURATED:
        return LEVEL_ERROR, 'saturated: the tension is beyond the range, release the tendon'
    if health.status & StrainStatus.STUCK:
        return LEVEL_WARN, (
            f'stuck: the same value for more than {config.stuck_s:g} s; check the load cell and '
            'its amplifier, or set stuck_s for a coarse sensor'
        )
    if health.restarts > before.restarts:
        return LEVEL_WARN, f'{format_restart(config)}; tare again'
    if health.reconnects > before.reconnects:
        return LEVEL_WARN, 'the link was lost and is back'
    if health.advice:
        return LEVEL_WARN, health.advice
    rejected = health.rejected_lines - before.rejected_lines
    if rejected:
        return LEVEL_WARN, (
            f'{rejected} lines were no readings, just now, such as "{health.last_rejected}"'
            + (f': {health.last_reason}' if health.last_reason else '')
        )
    lost = health.lost_samples - before.lost_samples
    dropped = sum(
        getattr(health, name) - getattr(before, name)
        for name in ('duplicates', 'late_samples', 'outliers')
    )
    if lost or dropped:
        return LEVEL_WARN, f'{lost} samples lost and {dropped} without a place, just now'
    return LEVEL_OK, 'samples arrive'


def format_restart(config: TendonSensorConfig) -> str:
    """Return the sentence for a device that has restarted, or of which nobody can know."""
    if config.sensor == 'line' and config.time_column < 0:
        return 'the link was lost and is back: a device without a clock may have restarted'
    return 'the device has restarted'


def _format_silence(
    silence_s: float, health: Health, before: Health, config: TendonSensorConfig
) -> str:
    sentence = f'no reading for {silence_s:.1f} s'
    if config.sensor == 'topic':
        if health.rejected_lines > before.rejected_lines:
            return f'{sentence}; messages arrive but hold no tension: {health.last_rejected}'
        return f'{sentence}; {health.advice}' if health.advice else sentence
    # What came before the last reading says nothing about the silence.
    if config.sensor != 'line' or before.heard_at_ns != health.heard_at_ns:
        return sentence
    if health.rejected_lines > before.rejected_lines:
        sentence += (
            f'; lines arrive but none is a reading in {config.unit}, such as '
            f'"{health.last_rejected}": '
            + (health.last_reason or 'check the columns, the unit and the baud')
        )
    elif health.bytes > before.bytes:
        sentence += '; bytes arrive but no lines: check the baud'
    return sentence


def to_values(health: Health) -> dict[str, object]:
    """Return the values of the diagnostics by name."""
    values = dataclasses.asdict(health)
    values['status'] = health.status.describe()
    return values
