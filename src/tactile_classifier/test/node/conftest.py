# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ROS context on a domain of its own for every test."""

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy.context import Context


@pytest.fixture
def context():
    with domain_id() as domain:
        context = Context()
        rclpy.init(context=context, domain_id=int(domain))
        yield context
        rclpy.try_shutdown(context=context)
