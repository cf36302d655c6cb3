# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records to ROS messages, and health to diagnostics."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from tendon_sensor_driver.records import Block, Health, StrainStatus, TendonSensorConfig

LEVEL_OK, LEVEL_WARN, LEVEL_ERROR = 0, 1, 2
"""The levels of ``diagnostic_msgs/DiagnosticStatus``."""


def _to_time_msg(stamp_ns: int) -> Any:
    from builtin_interfaces.msg import Time

    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Time(sec=seconds, nanosec=nanoseconds)


def to_strain_msg(block: Block, frame_id: str) -> Any:
    """Return the block as ``tactile_msgs/StrainBlock``."""
    from tactile_msgs.msg import StrainBlock

    message = StrainBlock()
    message.header.stamp = _to_time_msg(block.stamp_ns)
    message.header.frame_id = frame_id
    message.sequence = block.sequence
    message.period_ns = block.period_ns
    message.tension_n = block.tension_n.tolist()
    message.lost_before = block.lost_before
    message.stamp_error_s = block.stamp_error_s
    message.status = int(block.status)
    return message


def from_strain_msg(message: Any) -> Block:
    """Return what `to_strain_msg` was given, from a message of rclpy or of rosbags."""
    stamp = message.header.stamp
    return Block(
        stamp_ns=stamp.sec * 1_000_000_000 + stamp.nanosec,
        sequence=int(message.sequence),
        period_ns=int(message.period_ns),
        tension_n=np.array(message.tension_n, dtype=np.float64),
        lost_before=int(message.lost_before),
        stamp_error_s=float(message.stamp_error_s),
        status=StrainStatus(message.status),
    )


def to_wrench_msg(block: Block, frame_id: str) -> Any:
    """Return the block's last sample as ``geometry_msgs/WrenchStamped``, along +x.

    The type has no status: a saturated value is published as it is.
    """
    from geometry_msgs.msg import WrenchStamped

    last = len(block.tension_n) - 1
    message = WrenchStamped()
    message.header.stamp = _to_time_msg(block.stamp_ns + last * block.period_ns)
    message.header.frame_id = frame_id
    message.wrench.force.x = float(block.tension_n[last])
    return message


def assess_health(
    health: Health, before: Health, config: TendonSensorConfig, now_ns: int
) -> tuple[int, str]:
    """Return a level and a sentence that say how the link does.

    Parameters
    ----------
    health, before : Health
        Now, and at the last assessment.
    config : TendonSensorConfig
    now_ns : int
        The present time, on the clock of the client [ns].
    """
    if not health.is_connected:
        return LEVEL_ERROR, f'link down, reconnecting: {health.last_error}'
    silence_s = (now_ns - health.heard_at_ns) / 1e9
    if silence_s > config.silence_s:
        sentence = f'no reading for {silence_s:.1f} s'
        if health.rejected_lines > before.rejected_lines:
            sentence += (
                f'; lines arrive but none is a reading in {config.unit}, such as '
                f'"{health.last_rejected}": check the columns, the unit and the baud'
            )
        elif health.bytes > before.bytes:
            sentence += '; bytes arrive but no lines: check the baud'
        return LEVEL_WARN, sentence
    lost = health.lost_samples - before.lost_samples
    dropped = health.late_samples + health.outliers - before.late_samples - before.outliers
    if lost or dropped:
        return LEVEL_WARN, f'{lost} samples lost and {dropped} without a place, just now'
    return LEVEL_OK, 'samples arrive'


def to_values(health: Health) -> dict[str, object]:
    """Return the values of the diagnostics by name."""
    return dataclasses.asdict(health)
