# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every fault of a load-cell line: seen in the diagnostics and the blocks, and over again."""

import random
import threading
import time

from diagnostic_msgs.msg import DiagnosticStatus
import pytest

from tactile_ros.strain import StrainStatus
from tactile_testing.waiting import wait_until
from tendon_sensor_driver import encode_reading

PERIOD_S = 1 / 60
ANSWER_S = 5.0  # generous: other work may share the machine


class Board(threading.Thread):
    """Sends a line every 1/60 s, its tension in newtons saying its number, or a fault.

    Its clock does not stand still while this thread does: a late line has the time at which it
    was due, as that of a board, and no sample seems lost.
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
        while not self._ending.wait(max(0.0, self._time_s + PERIOD_S - time.monotonic())):
            self._time_s += PERIOD_S
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
    graph = make_graph(sensor.port, unit='N', saturation_n=50.0, tare_spread_n=1.0)
    assert graph.node.bring_up()
    graph.spin_until(graph.is_matched)
    graph.spin_until(lambda: len(graph.strain) > 5 and graph.sentence() == 'samples arrive')
    return graph


def check_samples(graph, board):
    """Nothing invented, nothing twice: each value is one that was sent, later ones later."""
    values = [round(n, 5) for message in graph.strain for n in message.tension_n]
    assert set(values) <= board.sent
    moving = [value for value in values if value not in (0.5, 99.0)]
    assert moving == sorted(set(moving))
    numbers = [message.sequence for message in graph.strain]
    assert numbers == sorted(set(numbers))


@pytest.mark.parametrize(
    ('fault', 'words', 'bit'),
    [
        ('mute', 'no reading for', None),
        ('garbage', 'were no readings|no reading for', StrainStatus.RESYNCHRONISED),
        ('half', 'were no readings', StrainStatus.RESYNCHRONISED),
        ('wrong baud', 'no reading for', StrainStatus.RESYNCHRONISED),
        ('saturate', 'saturated', StrainStatus.SATURATED),
        ('stuck', 'stuck: the same value', StrainStatus.STUCK),
    ],
)
def test_a_fault_is_seen_and_goes_with_its_cause(graph, board, fault, words, bit):
    first = len(graph.strain)
    board.fault = fault
    graph.spin_until(lambda: any(word in graph.sentence() for word in words.split('|')), ANSWER_S)
    assert graph.diagnostics[-1].status[0].level != DiagnosticStatus.OK
    board.fault = ''
    graph.spin_until(lambda: graph.sentence() == 'samples arrive', ANSWER_S)
    graph.spin_until(lambda: graph.strain[-1].status == StrainStatus.OK, ANSWER_S)
    if bit is not None:
        assert any(message.status & bit for message in graph.strain[first:])
    check_samples(graph, board)


def test_a_pulled_plug_is_seen_at_once_and_healed_after_the_return(graph, board, sensor):
    first = len(graph.strain)
    board.fault = 'unplug'
    sent = len(board.sent)
    wait_until(lambda: len(board.sent) >= sent + 2)  # the board writes no more
    sensor.unplug()
    graph.spin_until(lambda: 'link down' in graph.sentence(), ANSWER_S)
    assert graph.diagnostics[-1].status[0].level == DiagnosticStatus.ERROR
    sensor.plug_in()
    board.fault = ''
    graph.spin_until(lambda: len(graph.strain) > first + 5, ANSWER_S)
    assert any(m.status & StrainStatus.RECONNECTED for m in graph.strain[first:])
    graph.spin_until(lambda: graph.sentence() == 'samples arrive', ANSWER_S)
    check_samples(graph, board)


def test_a_board_that_restarts_takes_the_tare_with_it(graph, board):
    graph.spin_until(lambda: len(graph.strain) >= 60)
    assert graph.call('tare').success
    graph.spin_until(lambda: graph.tares and graph.tares[-1].is_set)
    graph.spin_until(lambda: 'tare_n' in graph.values() and graph.values()['tare_n'] != 'none')
    graph.spin_until(lambda: graph.values()['tare_drift_n'] != 'not known', ANSWER_S)
    board.restart()
    graph.spin_until(lambda: not graph.tares[-1].is_set, ANSWER_S)
    graph.spin_until(lambda: graph.values()['restarts'] == '1', ANSWER_S)
    assert 'restarted' in graph.sentence()
    assert any(message.status & StrainStatus.RECONNECTED for message in graph.strain)
    assert any(message.status & StrainStatus.RESTARTED for message in graph.strain)


def test_a_board_without_a_clock_that_comes_back_takes_the_tare_with_it(make_graph, sensor, board):
    graph = make_graph(sensor.port, unit='N', tare_spread_n=1.0, time_column=-1, tare_samples=30)
    assert graph.node.bring_up()
    graph.spin_until(lambda: len(graph.strain) >= 40)
    assert graph.call('tare').success
    graph.spin_until(lambda: graph.tares and graph.tares[-1].is_set)
    board.fault = 'unplug'
    sent = len(board.sent)
    wait_until(lambda: len(board.sent) >= sent + 2)  # the board writes no more
    sensor.unplug()
    graph.spin_until(lambda: 'link down' in graph.sentence(), ANSWER_S)
    first = len(graph.strain)
    sensor.plug_in()
    board.fault = ''
    graph.spin_until(lambda: len(graph.strain) > first, ANSWER_S)
    refused = graph.call('tare')
    assert not refused.success
    assert 'samples have come since the device has restarted, or may have' in refused.message
    graph.spin_until(lambda: not graph.tares[-1].is_set, ANSWER_S)
    graph.spin_until(lambda: graph.values()['restarts'] == '1', ANSWER_S)
    told = [d.status[0].message for d in graph.diagnostics]
    assert any('a device without a clock may have restarted; tare again' in text for text in told)
    assert graph.strain[first].status & StrainStatus.RESTARTED
    graph.spin_until(lambda: len(graph.strain) >= first + 40, ANSWER_S)
    assert graph.call('tare').success


@pytest.mark.parametrize('step_s', [5, -5])
def test_a_clock_that_is_set_leaves_the_tare(make_graph, sensor, board, step_s):
    graph = make_graph(sensor.port, unit='N', tare_spread_n=1.0)
    offset_ns = [0]
    graph.node.now_ns = lambda: time.time_ns() + offset_ns[0]
    assert graph.node.bring_up()
    graph.spin_until(lambda: len(graph.strain) >= 60)
    assert graph.call('tare').success
    graph.spin_until(lambda: graph.tares and graph.tares[-1].is_set)
    tares = len(graph.tares)
    offset_ns[0] = step_s * 10**9
    graph.spin_until(lambda: any(m.status & StrainStatus.CLOCK_STEP for m in graph.strain))
    count = len(graph.strain)
    graph.spin_until(lambda: len(graph.strain) >= count + 60)

    def behind_s():
        stamp = graph.strain[-1].header.stamp
        return time.time() + step_s - stamp.sec - stamp.nanosec / 1e9

    # Lines that were late when the clock was set put stamps ahead by as much, for so long.
    graph.spin_until(lambda: -0.1 < behind_s() < ANSWER_S)
    assert not any(m.status & StrainStatus.RESTARTED for m in graph.strain)
    assert len(graph.tares) == tares
    assert graph.values()['restarts'] == '0'
    assert not any('no reading' in d.status[0].message for d in graph.diagnostics[-3:])
    assert max(m.tension_n[0] for m in graph.strain[-10:]) < 0.2  # the tare is taken off


def test_a_menu_that_was_left_open_is_left(make_graph, sensor):
    graph = make_graph(sensor.port, unit='N')
    assert graph.node.bring_up()
    graph.spin_until(lambda: sensor.read() == b'\r', ANSWER_S)
    sensor.write(b'System Configuration\r\n1) Tare scale to zero [8421]\r\nx) Exit\r\n>')
    graph.spin_until(lambda: sensor.read() == b'x', ANSWER_S)
    sensor.write(b'Exiting\r\n' + encode_reading(5000, 0.5, 'N'))
    graph.spin_until(lambda: graph.strain, ANSWER_S)
    assert list(graph.strain[0].tension_n) == [0.5]
