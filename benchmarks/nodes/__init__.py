# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nodes and programs over ptys, UDP and DDS: cost, loss, latency, faults."""

from tactile_ros.process import share_one_heap

share_one_heap()  # as the nodes' programs do before their imports
