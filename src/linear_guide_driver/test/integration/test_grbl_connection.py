# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The connection to a Grbl controller whose answers are scripted by the test."""

from background import Background
from pty_peer import PtyPeer
import pytest

from linear_guide_driver.grbl.connection import GrblConnection
from linear_guide_driver.grbl.protocol import SOFT_RESET, STATUS_QUERY
from tactile_testing.waiting import wait_until

BANNER = b"Grbl 1.1h ['$' for help]\r\n"
IDLE, RUN = b'<Idle|MPos:0,0,0|FS:0,0>\r\n', b'<Run|MPos:0,0,0|FS:9,0>\r\n'


class Controller(PtyPeer):
    """Records received bytes, and replies to status queries."""

    def __init__(self):
        self.heard = self.answer = b''
        super().__init__()

    def take(self, data):
        self.heard += data
        if STATUS_QUERY in data:
            self.say(self.answer)


@pytest.fixture
def controller():
    controller = Controller()
    yield controller
    controller.close()


@pytest.fixture
def faults():
    return []


@pytest.fixture
def connection(controller, faults):
    connection = GrblConnection(
        controller.port, 115200, 10.0, on_report=lambda _: None, on_fault=faults.append
    )
    connection._link.start()
    yield connection
    connection.close()


def test_the_banners_of_a_repeated_reset_are_no_restart(connection, controller, faults):
    controller.answer = BANNER + IDLE  # the second banner comes late
    reset = Background(connection.reset)
    wait_until(lambda: controller.heard.count(SOFT_RESET) >= 2)
    controller.say(BANNER)
    assert reset.end() is None
    wait_until(lambda: connection._banners == 2)
    assert faults == []


def test_two_idle_reports_in_a_row_with_a_line_unanswered_are_a_stall(connection, controller):
    def say(report):
        count = connection._reports
        controller.say(report)
        wait_until(lambda: connection._reports > count)
        return connection.has_stalled

    dwell = Background(list, connection.stream([b'G4 P0.01\n'], 20.0))
    wait_until(lambda: controller.heard)
    assert [say(report) for report in (IDLE, RUN, IDLE, IDLE)] == [False, False, False, True]
    controller.say(b'ok\r\n')
    assert dwell.end() is None
    assert not connection.has_stalled
