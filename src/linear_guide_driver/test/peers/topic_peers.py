# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Publishers that replace the sensor and another driver."""

import threading
import time

from std_msgs.msg import Empty

from tactile_msgs.msg import StrainBlock
from tactile_ros.health import heartbeat_qos
from tactile_ros.qos import STREAM


class Peers:
    """Publishes strain and a heartbeat at 100 Hz until it is stopped; a context manager.

    ``tension_n`` is a number, or a function that returns one. The stamps of the samples are
    ``step_s`` ahead of the clock, and the samples arrive ``delay_s`` after they were taken.
    """

    def __init__(self, bench):
        self.tension_n = 0.0
        self.status = 0
        self.delay_s = self.step_s = 0.0
        self._taken_at_ns = self.published = 0
        self.beats = self.samples = True
        self._strain = bench.peer.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
        self._heart = bench.peer.create_publisher(Empty, 'heart', heartbeat_qos())
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
                self._publish(tension_n)
            if self.beats:
                self._heart.publish(Empty())

    def _publish(self, tension_n):
        taken_at_ns = time.time_ns() - round(self.delay_s * 1e9)
        # Stamps must increase even if the delay becomes longer.
        self._taken_at_ns = max(self._taken_at_ns + 1, taken_at_ns)
        stamp_ns = self._taken_at_ns + round(self.step_s * 1e9)
        block = StrainBlock(sequence=self.published, tension_n=[tension_n], status=self.status)
        block.header.stamp.sec, block.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        self._strain.publish(block)
        self.published += 1
