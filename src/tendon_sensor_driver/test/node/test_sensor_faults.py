# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults of a load cell appear in the diagnostics and the blocks, and end again."""

import random
import re
import threading
import time

from diagnostic_msgs.msg import DiagnosticStatus
import pytest

from tactile_ros.strain import StrainStatus
from tactile_testing.waiting import wait_until
from tendon_sensor_driver import encode_reading

RATE_HZ = 125.0
TARE = {'unit': 'N', 'rate_hz': RATE_HZ, 'tare_samples': 30, 'tare_spread_n': 1.0}


class Board(threading.Thread):
    """Simulated load-cell board that sends a line every 8 ms, and can have faults.

    The tension in a line [N] is the number of the line. Like a real board, the simulated board
    does not skip lines if its thread is paused. A late line contains the time at which it should
    have been sent.
    """

    def __init__(self, sensor):
        super().__init__(daemon=True)
        self.fault = ''
        self._sensor = sensor
        self._source = random.Random(4)
        self._ending = threading.Event()
        self._time_s = time.monotonic()
        self._restarted_s = 0.0
        self.sent = set()

    def restart(self):
        self._restarted_s = self._time_s

    def close(self):
        self._ending.set()
        self.join()

    def run(self):
        number = 0
        while not self._ending.wait(max(0.0, self._time_s + 1 / RATE_HZ - time.monotonic())):
            self._time_s += 1 / RATE_HZ
            number += 1
            value = round(0.1 + number * 1e-4, 5)
            self.sent.add(value)
            line = encode_reading(round((self._time_s - self._restarted_s) * 1000), value, 'N')
            if self.fault == 'unplug':
                continue
            self._sensor.write(self._spoil(line))

    def _spoil(self, line):
        if self.fault == 'mute':
            return b''
        if self.fault == 'garbage':
            return self._source.randbytes(12).replace(b'\n', b'') + line
        if self.fault == 'half':
            return line if self._source.random() < 0.5 else line[:4] + b'\r\n'
        if self.fault == 'wrong baud':
            return self._source.randbytes(len(line) // 2)
        if self.fault in ('saturate', 'stuck'):
            value = 99.0 if self.fault == 'saturate' else 0.5
            self.sent.add(value)
            return line.split(b',')[0] + b',%.5f,N,\r\n' % value
        return line


@pytest.fixture
def board(sensor):
    board = Board(sensor)
    board.start()
    yield board
    board.close()


@pytest.fixture
def graph(make_graph, sensor, board):
    graph = make_graph(sensor.port, **TARE, saturation_n=50.0, stuck_s=0.4)
    graph.bring_up()
    graph.await_more(5)
    graph.await_health(DiagnosticStatus.OK)
    return graph


def check_samples(graph, board):
    """Check that all received values were sent, without repetition and in the same order."""
    values = [round(n, 5) for message in graph.strain for n in message.tension_n]
    assert set(values) <= board.sent
    moving = [value for value in values if value not in (0.5, 99.0)]
    assert moving == sorted(set(moving))
    numbers = [message.sequence for message in graph.strain]
    assert numbers == sorted(set(numbers))


FAULTS = {
    'mute': ('no reading for', None),
    'garbage': ('no reading|could not be read', StrainStatus.RESYNCHRONISED),
    'half': ('could not be read', StrainStatus.RESYNCHRONISED),
    'wrong baud': ('no reading for', StrainStatus.RESYNCHRONISED),
    'saturate': ('saturated', StrainStatus.SATURATED),
    'stuck': ('stuck: the same value', StrainStatus.STUCK),
}


def test_each_fault_is_seen_and_goes_with_its_cause(graph, board):
    for fault, (words, bit) in FAULTS.items():
        first, told = len(graph.strain), len(graph.diagnostics)
        board.fault = fault
        graph.spin_until(lambda: re.search(words, graph.sentence()))  # noqa: B023 - called at once
        assert graph.diagnostics[-1].status[0].level != DiagnosticStatus.OK
        board.fault = ''
        graph.spin_until(lambda: graph.sentence() == 'samples arrive')
        graph.spin_until(lambda: graph.strain[-1].status == StrainStatus.OK)
        assert bit is None or any(message.status & bit for message in graph.strain[first:]), fault
        assert len(graph.diagnostics) > told + 1
    check_samples(graph, board)


def pull_the_plug(graph, board, sensor):
    """Unplug the board and plug it in again; return the index of the next block."""
    board.fault = 'unplug'
    sent = len(board.sent)
    wait_until(lambda: len(board.sent) >= sent + 2)  # wait for its last line
    sensor.unplug()
    graph.await_health(DiagnosticStatus.ERROR)
    first = len(graph.strain)
    sensor.plug_in()
    board.fault = ''
    graph.await_more()
    return first


def take_tare(graph):
    graph.await_more(40)
    answer = graph.call('tare')
    assert answer.success, answer.message
    graph.spin_until(lambda: graph.tares and graph.tares[-1].is_set)


def test_a_pulled_plug_is_seen_at_once_and_healed_after_the_return(graph, board, sensor):
    first = pull_the_plug(graph, board, sensor)
    assert graph.strain[first].status & StrainStatus.RECONNECTED
    graph.await_health(DiagnosticStatus.OK)
    check_samples(graph, board)


def test_a_board_that_restarts_takes_the_tare_with_it(graph, board):
    take_tare(graph)
    graph.spin_until(lambda: graph.values().get('tare_n', 'none') != 'none')
    graph.spin_until(lambda: graph.values()['tare_drift_n'] != 'not known')
    board.restart()
    graph.spin_until(lambda: not graph.tares[-1].is_set)
    graph.spin_until(lambda: graph.values()['restarts'] == '1')
    both = StrainStatus.RECONNECTED | StrainStatus.RESTARTED
    graph.spin_until(lambda: any(message.status & both == both for message in graph.strain))


def test_a_board_without_a_clock_that_comes_back_takes_the_tare_with_it(make_graph, sensor, board):
    columns = {'time_column': -1, 'line_columns': 3}
    graph = make_graph(sensor.port, **{**TARE, 'tare_samples': 200}, **columns)
    graph.bring_up()
    graph.await_more(200)
    assert graph.call('tare').success
    first = pull_the_plug(graph, board, sensor)
    # The board must not send during the service call, or there could be enough samples again.
    board.fault = 'unplug'
    refused = graph.call('tare')
    board.fault = ''
    assert not refused.success
    assert 'of 200' in refused.message
    graph.spin_until(lambda: not graph.tares[-1].is_set)
    graph.spin_until(lambda: graph.values()['restarts'] == '1')
    assert any('tare again' in d.status[0].message for d in graph.diagnostics)
    assert graph.strain[first].status & StrainStatus.RESTARTED


def test_a_clock_that_is_set_leaves_the_tare(make_graph, sensor, board):
    graph = make_graph(sensor.port, **TARE)
    offset_s = 0
    graph.node.now_ns = lambda: time.time_ns() + offset_s * 10**9
    graph.bring_up()
    take_tare(graph)
    tares = len(graph.tares)

    def behind_s():
        stamp = graph.strain[-1].header.stamp
        return time.time() + offset_s - stamp.sec - stamp.nanosec / 1e9

    def count_steps():
        return sum(bool(m.status & StrainStatus.CLOCK_STEP) for m in graph.strain)

    for steps, offset_s in enumerate((5, 0), 1):  # noqa: B007 - two functions read it
        graph.spin_until(lambda: count_steps() == steps)  # noqa: B023 - called at once
        graph.await_more(30)
        # If lines were late when the clock was set, the stamps are also late for some time.
        graph.spin_until(lambda: -0.1 < behind_s() < 4.0)
    graph.await_health(DiagnosticStatus.OK)
    assert not any(m.status & StrainStatus.RESTARTED for m in graph.strain)
    assert len(graph.tares) == tares
    assert graph.values()['restarts'] == '0'
    assert max(m.tension_n[0] for m in graph.strain[-10:]) < 0.2  # the tare is still subtracted


def test_a_menu_that_was_left_open_is_left(make_graph, sensor):
    graph = make_graph(sensor.port, unit='N', silence_s=0.1)
    graph.bring_up()
    graph.spin_until(lambda: sensor.read() == b'\r')
    sensor.write(b'System Configuration\r\n1) Tare scale to zero [8421]\r\nx) Exit\r\n>')
    graph.spin_until(lambda: sensor.read() == b'x')
    sensor.write(b'Exiting\r\n' + encode_reading(5000, 0.5, 'N'))
    graph.spin_until(lambda: graph.strain)
    assert list(graph.strain[0].tension_n) == [0.5]
