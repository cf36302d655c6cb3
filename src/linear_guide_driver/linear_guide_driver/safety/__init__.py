# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rules of what may move and what must not. They know no IO; the nodes feed them."""

from linear_guide_driver.safety.liveness import find_loss, SampleLag, TopicWatchdog, Watch
from linear_guide_driver.safety.tendon_safety import (
    Ending,
    Order,
    Pull,
    SLACK_M,
    State,
    TendonSafety,
    Zero,
)

__all__ = [
    'SLACK_M',
    'Ending',
    'Order',
    'Pull',
    'SampleLag',
    'State',
    'TendonSafety',
    'TopicWatchdog',
    'Watch',
    'Zero',
    'find_loss',
]
