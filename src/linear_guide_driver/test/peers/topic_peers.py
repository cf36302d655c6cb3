# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sensor and another driver, as a motion node hears them."""

import threading

from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Empty

from tactile_msgs.msg import StrainBlock
from tactile_ros.qos import STREAM


class Peers:
    """Publishes strain and a heartbeat at 100 Hz until told otherwise. A context manager.

    ``tension_n`` is a number or a function.
    """

    def __init__(self, bench):
        self.tension_n = 0.0
        self.status = 0
        self.beats = self.samples = True
        self._strain = bench.peer.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
        self._heart = bench.peer.create_publisher(Empty, 'heart', qos_profile_sensor_data)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *error):
        self._end.set()
        self._thread.join()

    def _run(self):
        while not self._end.wait(0.01):
            if self.samples:
                tension_n = self.tension_n() if callable(self.tension_n) else self.tension_n
                self._strain.publish(StrainBlock(tension_n=[tension_n], status=self.status))
            if self.beats:
                self._heart.publish(Empty())
