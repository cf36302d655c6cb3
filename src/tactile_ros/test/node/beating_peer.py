# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Program of a node that publishes a heartbeat: ``beating_peer.py NAME``."""

import sys
import time

import rclpy

from tactile_ros.health import Heartbeat

if __name__ == '__main__':
    rclpy.init()
    heart = Heartbeat(rclpy.create_node(sys.argv[1]), lambda: True)
    while True:
        heart.beat()
        time.sleep(0.02)
