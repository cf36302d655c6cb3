# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Benchmarks of nodes and programs that communicate over ptys, UDP and DDS.

They measure processor time, lost samples, latency, and behaviour after faults.
"""

from tactile_ros.process import share_one_heap

share_one_heap()  # before other imports, as in the node programs
