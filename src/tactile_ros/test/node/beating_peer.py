# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Program that runs a node with a heartbeat; the argument is the name of the node."""

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
