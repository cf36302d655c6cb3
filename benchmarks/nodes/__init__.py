# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nodes and programs with ptys, UDP and DDS: processor time, loss, latency and faults."""

from tactile_ros.process import share_one_heap

share_one_heap()  # like the node programs, before other imports
