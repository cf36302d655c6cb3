# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Records of this package to messages."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

from tactile_bags.auditing.audit import Audit
from tactile_msgs.msg import RecordingAudit


def audit_to_msg(audit: Audit, bag: str) -> RecordingAudit:
    """Return the ``tactile_msgs/RecordingAudit`` of a record."""
    return RecordingAudit(
        header=Header(stamp=_time(audit.end_ns)),
        bag=bag,
        finger=audit.finger,
        trial_id=audit.trial_id,
        passed=audit.passed,
        findings=list(audit.findings),
        span_start=_time(audit.start_ns),
        sample_count=audit.sample_count,
        lost_count=min(audit.lost_count, 2**64 - 1),  # two wild numbers make any gap
        gap_count=audit.gap_count,
        duplicate_count=audit.duplicate_count,
        disordered_count=audit.disordered_count,
        rate_hz=audit.rate_hz,
        nominal_rate_hz=audit.nominal_rate_hz,
        largest_step_s=audit.largest_step_s,
    )


def _time(stamp_ns: int) -> Time:
    sec, nanosec = divmod(stamp_ns, 10**9)
    return Time(sec=max(-(2**31), min(sec, 2**31 - 1)), nanosec=nanosec)
