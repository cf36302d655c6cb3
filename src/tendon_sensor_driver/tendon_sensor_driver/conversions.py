# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Conversion of records to ROS messages, and of the sensor's health to diagnostics."""

from __future__ import annotations

import array
import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_ros.message_classes import time_to_msg
from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.config import AXES, TendonSensorConfig
from tendon_sensor_driver.tare import TareValue
from tendon_sensor_driver.types import SensorHealth

LEVEL_OK, LEVEL_WARN, LEVEL_ERROR = 0, 1, 2
"""The levels of ``diagnostic_msgs/DiagnosticStatus``."""

_TIMES = {'line': 'device time', 'net_ft': 'sample counter'}


def to_strain_msg(block: StrainBlock, frame_id: str) -> Any:
    """Return the block as ``tactile_msgs/StrainBlock``."""
    from tactile_msgs.msg import StrainBlock as StrainBlockMsg

    message = StrainBlockMsg()
    message.header.stamp = time_to_msg(block.stamp_ns)
    message.header.frame_id = frame_id
    message.sequence = block.sequence
    message.period_ns = block.period_ns
    # An array is faster than a list, of which rclpy checks every element.
    message.tension_n = array.array('d', block.tension_n.tobytes())
    message.lost_before = block.lost_before
    message.stamp_error_s = block.stamp_error_s
    message.status = int(block.status)
    return message


def to_wrench_msg(block: StrainBlock, frame_id: str, axis: str = 'fx', scale: float = 1.0) -> Any:
    """Return the block's last sample as ``geometry_msgs/WrenchStamped``.

    The tension is the force along +x.

    The wrench of a six-axis sensor is rotated from the sensor's own axes into ``frame_id``. The
    +x axis of this frame points along ``axis``, or in the opposite direction if ``scale`` is
    negative. As the message has no status, a saturated value cannot be told from a valid one.
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
    """Return a wrench in the frame whose +x points along ``axis``.

    Parameters
    ----------
    wrench : ndarray of shape (6,)
        Force [N] and torque [N m] in the sensor's own axes.
    axis : str
        One of ``AXES``. The other two axes follow in cyclic order.
    scale : float
        If negative, the frame is also rotated by half a turn about its second axis. Then +x
        points in the direction opposite to ``axis``, and the frame stays right-handed.
    """
    first = AXES.index(axis) % 3
    order = [(first + i) % 3 for i in range(3)]
    turned: NDArray[np.float64] = wrench[order + [3 + i for i in order]]
    if scale < 0:
        turned = turned * np.array([-1.0, 1.0, -1.0, -1.0, 1.0, -1.0])
    return turned


def to_tare_msg(tare: TareValue, frame_id: str) -> Any:
    """Return the tare as ``tactile_msgs/Tare``."""
    from tactile_msgs.msg import Tare

    message = Tare()
    message.header.stamp = time_to_msg(tare.stamp_ns)
    message.header.frame_id = frame_id
    message.is_set = tare.samples > 0
    message.bias_n = tare.tare_n
    message.spread_n = tare.spread_n
    message.samples = tare.samples
    return message


def assess_health(
    health: SensorHealth, before: SensorHealth, config: TendonSensorConfig, now_ns: int
) -> tuple[int, str]:
    """Return the level and the message of the diagnostics.

    Parameters
    ----------
    health, before : SensorHealth
        Present state, and the state about a second ago. Counters that have increased since then
        are reported.
    config : TendonSensorConfig
        Parameters of the sensor.
    now_ns : int
        Present time on the client's clock [ns].
    """
    if not health.is_connected:
        what = 'no samples' if config.sensor == 'topic' else 'link down, reconnecting'
        return LEVEL_ERROR, what if health.last_error is None else f'{what}: {health.last_error}'
    silence_s = (now_ns - health.heard_at_ns) / 1e9
    if silence_s > config.silence_s:
        return LEVEL_WARN, _format_silence(silence_s, health, before, config)
    if health.device_status or health.status & StrainStatus.DEVICE_ERROR:
        return LEVEL_ERROR, f'the device reports: {health.device_status or "an error"}'
    if health.status & StrainStatus.SATURATED:
        return LEVEL_ERROR, 'saturated: the tension is out of range; slacken the tendon'
    if health.status & StrainStatus.STUCK:
        what = 'publisher' if config.sensor == 'topic' else 'load cell and its amplifier'
        return LEVEL_WARN, (
            f'stuck: the same value for more than {config.stuck_s:g} s; check the {what}, or set '
            'stuck_s to 0 for a sensor of coarse resolution'
        )
    if health.restarts > before.restarts:
        return LEVEL_WARN, f'{format_restart(config)}; tare again'
    if health.reconnects > before.reconnects:
        return LEVEL_WARN, 'the link was lost and has been re-established'
    if health.advice is not None:
        return LEVEL_WARN, health.advice
    rejected = health.rejected_lines - before.rejected_lines
    if rejected:
        what = 'message' if config.sensor == 'topic' else 'line'
        return LEVEL_WARN, (
            f'{rejected} {what}{"" if rejected == 1 else "s"} could not be read during the last '
            f'second, such as "{health.last_rejected}"'
            + ('' if health.last_reason is None else f': {health.last_reason}')
        )
    lost = health.lost_samples - before.lost_samples
    irregular = health.irregular_stamps - before.irregular_stamps
    dropped = sum(
        getattr(health, name) - getattr(before, name)
        for name in ('duplicates', 'late_samples', 'outliers')
    )
    if lost or dropped:
        if config.sensor != 'topic':
            missing = f'{lost} missing, judged by their {_TIMES[config.sensor]}'
        elif irregular:
            missing = f'irregular stamps: {irregular}, whose samples are late or missing'
        else:
            missing = f'{lost} missing: messages were lost, or the publisher paused'
        parts = [missing] * bool(lost)
        parts += [f'{dropped} dropped: duplicate, late or implausible time'] * bool(dropped)
        return LEVEL_WARN, f'samples during the last second: {"; ".join(parts)}'
    if irregular:
        return LEVEL_OK, (
            f'samples arrive; irregular stamps during the last second: {irregular}, no message is '
            'missing. Let the publisher stamp the time of the measurement, not of sending'
        )
    return LEVEL_OK, 'samples arrive'


def format_restart(config: TendonSensorConfig) -> str:
    """Return the message for a device that has restarted, or may have restarted."""
    if config.sensor == 'line' and config.time_column < 0:
        return (
            'the link was lost and has been re-established; the device may have restarted, which '
            'cannot be detected because it sends no time'
        )
    return 'the device has restarted'


def _format_silence(
    silence_s: float, health: SensorHealth, before: SensorHealth, config: TendonSensorConfig
) -> str:
    sentence = f'no reading for {silence_s:.1f} s'
    if config.sensor == 'topic':
        if health.rejected_lines > before.rejected_lines:
            return f'{sentence}; messages arrive, but without a tension: {health.last_rejected}'
        return sentence if health.advice is None else f'{sentence}; {health.advice}'
    # Counters are compared only if ``before`` is already part of the present silence.
    if config.sensor != 'line' or before.heard_at_ns != health.heard_at_ns:
        return sentence
    if health.rejected_lines > before.rejected_lines:
        sentence += (
            f'; lines arrive, but none is a reading in {config.unit}, such as '
            f'"{health.last_rejected}": '
            + (health.last_reason or 'check the columns, the unit and the baud')
        )
    elif health.bytes > before.bytes:
        sentence += '; bytes arrive, but no lines: check the baud'
    return sentence


def to_values(health: SensorHealth) -> dict[str, object]:
    """Return the key-value pairs of the diagnostics."""
    values = dataclasses.asdict(health)
    values['status'] = health.status.describe()
    return values
