# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Goals of drivers that are stopped (SIGSTOP) and continued: nothing moves after that."""

from contextlib import contextmanager
import os
from pathlib import Path
import signal
import subprocess
import time

from action_msgs.msg import GoalStatus
from ament_index_python.packages import get_package_prefix
import pytest

from tactile_msgs.action import HomeGuide, MoveGuide, PullTendon
from tactile_ros.clock_watch import MOST_S
from tactile_ros.goal_client import GoalClient
from tactile_ros.goals import EXPIRE_S
from tactile_testing.waiting import wait_until

START_S = 60.0
"""Longest time [s] until a process has started on a busy computer."""

FROZEN_S = 2 * MOST_S
AFTER_S = EXPIRE_S + 0.5
"""Time after a frozen driver has been continued in which nothing may move [s]."""

PULL = PullTendon.Goal(displacement_m=0.004, speed_m_s=0.02, contact='flexion')
MOVE = MoveGuide.Goal(position_m=0.15, speed_m_s=0.02)
SHORT_MOVE = MoveGuide.Goal(position_m=0.02, speed_m_s=0.1)
"""A move that shows that a driver works again."""

PIECE_MM = 0.3
"""Distance that exceeds one piece of `MOVE` [mm]. A piece lasts 0.25 s / 19, at 20 mm/s."""


class Driver:
    """A driver's program, and clients of its actions."""

    def __init__(self, bench, name, actions, **parameters):
        folder = Path(get_package_prefix('linear_guide_driver'), 'lib/linear_guide_driver')
        words = [word for item in parameters.items() for word in ('-p', '{}:={}'.format(*item))]
        self._process = subprocess.Popen(
            [folder / f'{name}_node', '--ros-args', *words],
            env={**os.environ, 'ROS_DOMAIN_ID': str(bench.context.get_domain_id())},
        )
        self._clients = {
            kind: GoalClient(bench.peer, kind, f'{name}/{verb}') for kind, verb in actions.items()
        }
        bench._thread.start()
        for client in self._clients.values():
            assert client.wait_for_server(START_S)

    def send(self, message):
        kind = next(kind for kind in self._clients if isinstance(message, kind.Goal))
        return self._clients[kind].send(message)

    def succeed(self, message):
        """Send a goal repeatedly until it succeeds, because the node may not be ready yet."""

        def has_succeeded():
            return self.end(self.send(message))[0] == GoalStatus.STATUS_SUCCEEDED

        wait_until(has_succeeded, timeout_s=START_S)

    def end(self, goal):
        reply = goal.end.result(START_S)
        return reply.status, reply.result.message

    @contextmanager
    def frozen(self):
        self._process.send_signal(signal.SIGSTOP)
        end_s = time.monotonic() + FROZEN_S
        yield
        wait_until(lambda: time.monotonic() > end_s)
        self._process.send_signal(signal.SIGCONT)

    def close(self):
        self._process.kill()
        self._process.wait()
        for client in self._clients.values():
            client.close()


@pytest.fixture
def guide(bench, grbl):
    actions = {HomeGuide: 'home', MoveGuide: 'move'}
    driver = Driver(bench, 'linear_guide', actions, port=grbl.port, tendon_topic="''")
    try:
        driver.succeed(HomeGuide.Goal())
        yield driver
    finally:
        driver.close()


@pytest.fixture
def tendon(bench, servo):
    values = {'port': servo.port, 'unguarded': True, 'watchdog_s': 1.0}
    driver = Driver(bench, 'tendon_actuator', {PullTendon: 'pull'}, **values)
    try:
        driver.succeed(PullTendon.Goal(displacement_m=0.0, speed_m_s=0.02))
        yield driver
    finally:
        driver.close()


def assert_rests(read_position, most=0.0):
    """Check that the position changes by at most ``most`` during `AFTER_S`."""
    start, end_s = read_position(), time.monotonic() + AFTER_S
    seen = []
    wait_until(lambda: seen.append(read_position()) or time.monotonic() > end_s)
    assert max(abs(position - start) for position in seen) <= most


def assert_ended_by_standstill(driver, goal):
    status, message = driver.end(goal)
    assert status == GoalStatus.STATUS_ABORTED
    assert 'again' in message


def test_a_frozen_guide_refuses_the_moves_that_were_sent_meanwhile(guide, grbl):
    with guide.frozen():
        goals = [guide.send(MOVE), guide.send(HomeGuide.Goal())]
    assert_rests(lambda: grbl.mpos)
    for goal in goals:
        assert_ended_by_standstill(guide, goal)
    guide.succeed(HomeGuide.Goal())
    guide.succeed(SHORT_MOVE)


def test_a_move_in_which_the_guides_driver_was_frozen_is_over(guide, grbl):
    goal = guide.send(MOVE)
    wait_until(lambda: grbl.is_moving)
    with guide.frozen():
        # Grbl has executed the motion that it had received in advance
        wait_until(lambda: not grbl.is_moving)
    # If the driver was frozen just before it sent a piece of the move, it sends this piece now.
    assert_rests(lambda: grbl.mpos, most=PIECE_MM)
    assert_ended_by_standstill(guide, goal)


def test_a_frozen_tendon_refuses_the_pull_that_was_sent_meanwhile(tendon, servo):
    with tendon.frozen():
        goal = tendon.send(PULL)
    assert_rests(lambda: servo.goal)
    assert_ended_by_standstill(tendon, goal)
    tendon.succeed(PULL)


def test_a_pull_to_slack_that_was_sent_to_a_frozen_tendon_is_carried_out(tendon, servo):
    tendon.succeed(PULL)
    with tendon.frozen():
        goal = tendon.send(PullTendon.Goal(displacement_m=0.0, speed_m_s=0.02))
    assert tendon.end(goal)[0] == GoalStatus.STATUS_SUCCEEDED
