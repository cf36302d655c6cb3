# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`TendonSensorClient` with pseudo-terminals: silence, garbage, unplugging, slow consumers."""

from itertools import pairwise
import os
import threading
import time
from types import SimpleNamespace

import pytest

from tactile_ros.strain import StrainStatus
from tactile_testing.waiting import wait_until
from tendon_sensor_driver import client as module
from tendon_sensor_driver import (
    encode_reading,
    LinkError,
    TendonSensorClient,
    TendonSensorConfig,
)
from tendon_sensor_driver.client import find_serial_number, SerialTransport

SECOND_NS = 1_000_000_000
MS_NS = 1_000_000


@pytest.fixture
def blocks():
    return []


@pytest.fixture
def make_client(sensor, blocks):
    clients = []

    def make(on_block=blocks.append, now_ns=time.time_ns, **options):
        config = TendonSensorConfig(port=sensor.port, **options)
        clients.append(TendonSensorClient(config, on_block, now_ns))
        clients[-1].open()
        return clients[-1]

    yield make
    for client in clients:
        client.close()


def test_readings_come_out_as_blocks(sensor, make_client, blocks):
    before_ns = time.time_ns()
    client = make_client()
    lines = (encode_reading(1000 + i * 1000 // 60, i / 100) for i in range(10))
    sensor.write(b'34,kg,\r\n' + b''.join(lines))
    wait_until(lambda: len(blocks) == 10)
    assert [block.sequence for block in blocks] == list(range(10))
    assert [block.tension_n.tolist() for block in blocks] == [
        [i / 100 * 9.80665] for i in range(10)
    ]
    assert {block.status for block in blocks} == {StrainStatus.OK}
    # The samples of 150 ms are written at once, so the oldest one gets a stamp 150 ms ago.
    assert before_ns - 150_000_000 <= blocks[0].stamp_ns < time.time_ns()
    health = client.health()
    assert health.is_connected
    assert (health.lines, health.readings, health.rejected_lines) == (10, 10, 0)
    # The ten lines are received by one or more reads. Reads of at least three lines are counted.
    assert 1 <= health.bursts <= 3
    for ticks in (1150, 1133, 1167):
        sensor.write_reading(ticks, 0.9)
    wait_until(lambda: len(blocks) == 11)
    health = client.health()
    assert (health.duplicates, health.late_samples, health.lost_samples) == (1, 1, 0)


def test_readings_that_waited_in_the_port_are_stamped_when_they_were_taken(
    sensor, make_client, blocks, monkeypatch
):
    read, waiting = module.SerialTransport.read, threading.Event()

    def read_late(self, timeout_s):
        waiting.wait(5.0)
        return read(self, timeout_s)

    monkeypatch.setattr(module.SerialTransport, 'read', read_late)
    make_client()
    sensor.write(b'\n' + b''.join(encode_reading(1000 + 20 * i, 0.5) for i in range(20)))
    time_ns = time.time_ns()
    waiting.set()
    wait_until(lambda: len(blocks) == 20)
    stamps_ns = [block.stamp_ns for block in blocks]
    assert [after - before for before, after in pairwise(stamps_ns)] == [20_000_000] * 19
    assert time_ns <= stamps_ns[-1] < time.time_ns()


@pytest.mark.parametrize(('name', 'remedy'), [('absent', 'cable'), ('f', '')])
def test_what_is_no_port_is_named_with_a_remedy(tmp_path, name, remedy):
    (tmp_path / 'f').write_text('1,2\n')
    config = TendonSensorConfig(port=str(tmp_path / name))
    client = TendonSensorClient(config, print, time.time_ns)
    with pytest.raises(LinkError, match=f'{config.port}.*{remedy}'):
        client.open()
    client.close()


def test_nobody_else_opens_the_port_of_a_client(make_client):
    make_client()
    with pytest.raises(LinkError, match='another program'):
        make_client()


def test_close_lets_go_of_the_port_and_hands_out_what_arrived(sensor, make_client, blocks):
    client = make_client(samples_per_block=100, silence_s=30.0)
    sensor.write(b'\n' + encode_reading(0, 0.5) + encode_reading(17, 0.6))
    wait_until(lambda: client.health().readings == 2)
    assert blocks == []
    client.close()
    client.close()
    # There is no error, because `close` did not have to wait for the end of the silence.
    assert client.health().last_error is None
    assert [len(block.tension_n) for block in blocks] == [2]
    assert not client.health().is_connected
    make_client()


def test_an_unfinished_block_does_not_wait_out_a_silence(sensor, make_client, blocks):
    client = make_client(samples_per_block=100, silence_s=0.05)
    sensor.write(b'\n' + encode_reading(0, 0.5) + encode_reading(17, 0.6))
    wait_until(lambda: blocks)
    assert len(blocks[0].tension_n) == 2
    assert client.health().is_connected


def test_garbage_is_counted_and_told_but_never_a_sample(sensor, make_client, blocks):
    client = make_client()
    sensor.write(b'\n\x00\xff\xfe7,7\r\n' + b'y' * 5000 + b'\r\n')
    sensor.write(encode_reading(0, 0.5) + b'1,nan,kg,\r\n' + encode_reading(17, 0.5))
    wait_until(lambda: len(blocks) == 2)
    assert {block.status for block in blocks} == {StrainStatus.RESYNCHRONISED}
    assert client.health().rejected_lines == 3
    assert client.health().last_rejected == '1,nan,kg,'


def test_ports_that_vanish_while_they_are_listed_keep_no_sensor_away(
    sensor, make_client, blocks, monkeypatch
):
    """If a port is unplugged while pyserial lists all ports, pyserial raises a TypeError."""
    real, vanishing = module.list_ports.comports, []

    def comports():
        if vanishing:
            vanishing.pop()
            int(None)
        return real()

    monkeypatch.setattr(module.list_ports, 'comports', comports)
    client = make_client()
    sensor.unplug()
    wait_until(lambda: not client.health().is_connected)
    vanishing.append(True)
    sensor.plug_in()
    wait_until(lambda: client.health().reconnects == 1)
    assert not vanishing
    sensor.write(b'\n' + encode_reading(0, 0.5))
    wait_until(lambda: blocks)


def test_unplugging_mid_line_reconnects_and_joins_nothing(sensor, make_client, blocks):
    started_ns = time.monotonic_ns()

    def device_ms():
        return 10_000 + (time.monotonic_ns() - started_ns) // 1_000_000

    client = make_client()
    sensor.write(b'\n' + encode_reading(device_ms(), 0.25) + b'10100,0.7')
    wait_until(lambda: len(blocks) == 1)
    sensor.unplug()
    wait_until(lambda: not client.health().is_connected)
    lost = client.health().last_error
    assert sensor.port in lost
    wait_until(lambda: client.health().last_error != lost)  # the attempt to reconnect fails

    sensor.plug_in()
    wait_until(lambda: client.health().reconnects == 1)
    sensor.write(b'5000,kg,\r\n' + encode_reading(device_ms(), 0.5))
    wait_until(lambda: len(blocks) == 2)
    assert blocks[1].tension_n.tolist() == [0.5 * 9.80665]
    assert blocks[1].status == StrainStatus.RECONNECTED
    # The device clock continued, so the number of lost samples is known.
    gap = (blocks[1].stamp_ns - blocks[0].stamp_ns) / blocks[0].period_ns
    assert blocks[1].lost_before == pytest.approx(gap - 1, abs=1)
    assert blocks[1].sequence == 1 + blocks[1].lost_before > 10
    assert client.health().rejected_lines == 0


def test_close_does_not_wait_for_a_sensor_that_is_away(sensor, make_client, monkeypatch):
    monkeypatch.setattr(module, 'FIRST_DELAY_S', 30.0)
    client = make_client()
    sensor.unplug()
    wait_until(lambda: not client.health().is_connected)
    client.close()
    said = client.health().last_error or ''
    assert 'does not return' not in said  # the message if the thread has not ended


@pytest.fixture
def slow_client(make_client, blocks, monkeypatch):
    """Return a function that makes a client whose ``on_block`` waits for an event.

    The function returns the client and the event.
    """

    def make(longest_delivery_ns):
        name = 'tendon_sensor_driver.line_sensor.LONGEST_DELIVERY_NS'
        monkeypatch.setattr(name, longest_delivery_ns)
        gate = threading.Event()
        return make_client(lambda block: (blocks.append(block), gate.wait())), gate

    return make


def test_what_comes_while_a_consumer_takes_too_long_is_dropped_and_told(
    sensor, slow_client, blocks
):
    """The waiting bytes are dropped, because some bytes between them could be missing."""
    client, gate = slow_client(0)
    sensor.write(b'\n' + encode_reading(0, 0.5))
    wait_until(lambda: blocks)
    sensor.write(encode_reading(17, 0.5) + encode_reading(33, 0.5) + b'50,0.')
    gate.set()
    wait_until(lambda: client.health().overruns)
    sensor.write(b'90000,kg,\r\n' + encode_reading(67, 0.5))
    wait_until(lambda: len(blocks) == 2)
    assert blocks[1].tension_n.tolist() == [0.5 * 9.80665]
    assert (blocks[1].sequence, blocks[1].lost_before) == (4, 3)
    assert blocks[1].status == StrainStatus.RESYNCHRONISED


def test_a_consumer_that_is_quick_enough_loses_nothing(sensor, slow_client, blocks):
    client, gate = slow_client(10**12)
    sensor.write(b'\n' + b''.join(encode_reading(17 * i, 0.5) for i in range(20)))
    wait_until(lambda: blocks)
    sensor.write(b''.join(encode_reading(17 * i, 0.5) for i in range(20, 40)))
    gate.set()
    wait_until(lambda: len(blocks) == 40)
    assert client.health().overruns == client.health().lost_samples == 0


def test_the_consumer_may_close_the_client(sensor, make_client):
    done = threading.Event()

    def on_block(_):
        client.close()
        done.set()

    client = make_client(on_block)
    sensor.write(b'\n' + encode_reading(0, 0.5))
    wait_until(done.is_set)
    wait_until(lambda: not client.health().is_connected)


def wait_for_silences(client, count=5):
    """Wait until the client has noticed ``count`` times that its sensor is silent."""
    silences, leave_menu = [], client._leave_menu
    client._leave_menu = lambda link: silences.append(leave_menu(link))
    wait_until(lambda: len(silences) >= count)


@pytest.mark.parametrize('leave_menu', [True, False])
def test_a_board_that_has_spoken_or_is_to_be_left_alone_hears_nothing(
    sensor, make_client, blocks, leave_menu
):
    client = make_client(silence_s=0.02, leave_menu=leave_menu)
    if leave_menu:
        sensor.write(b'\n' + encode_reading(0, 0.5))
        wait_until(lambda: blocks)
        sensor.read()  # drop what the client has sent before the first line
    wait_for_silences(client)
    assert sensor.read() == b''


# -- the host's clock is set ---------------------------------------------------------------


@pytest.fixture
def clock(monkeypatch):
    """Return replacements of the monotonic clock and the host's clock that the test controls."""
    clock = SimpleNamespace(passed_ns=0, ahead_ns=10**9 * SECOND_NS)
    clock.monotonic_ns = lambda: clock.passed_ns
    clock.now_ns = lambda: clock.passed_ns + clock.ahead_ns
    monkeypatch.setattr('tendon_sensor_driver.clock.time', clock)
    # Without this higher limit, a delay on a busy computer would count as a slow consumer.
    monkeypatch.setattr('tendon_sensor_driver.line_sensor.LONGEST_DELIVERY_NS', 10**18)
    return clock


@pytest.fixture
def send(sensor, blocks, clock):
    """Return a function that sends ``count`` readings and waits until each has arrived."""

    def send(count):
        for _ in range(count):
            before = len(blocks)
            clock.passed_ns += 10 * MS_NS
            sensor.write_reading(clock.passed_ns // MS_NS, 0.5 + before * 1e-5)
            wait_until(lambda before=before: len(blocks) > before, poll_s=0.0005)

    return send


@pytest.mark.parametrize('step_s', [5, -0.3, 0.3, -3600])
def test_a_step_of_the_clock_is_no_restart_and_no_silence(
    sensor, make_client, blocks, clock, send, step_s
):
    client = make_client(now_ns=clock.now_ns, rate_hz=100.0)
    sensor.write(b'\n')
    send(10)
    clock.ahead_ns += round(step_s * SECOND_NS)
    assert 0.0 <= (clock.now_ns() - client.health().heard_at_ns) / 1e9 < 2.0
    send(10)
    before, after = blocks[:10], blocks[10:]
    assert {block.status for block in (*before, *after[1:])} == {StrainStatus.OK}
    assert after[0].status == StrainStatus.CLOCK_STEP
    health = client.health()
    assert (health.restarts, health.outliers, health.late_samples) == (0, 0, 0)
    # The stamps follow the host's clock from the first sample after it was set.
    for block in (after[0], after[-1]):
        assert -0.2 < (clock.now_ns() - block.stamp_ns) / 1e9 < 1.0
    apart_s = (after[0].stamp_ns - before[-1].stamp_ns) / 1e9
    assert apart_s == pytest.approx(step_s, abs=0.02)
    assert [block.sequence for block in blocks] == list(range(20))


def test_a_step_while_the_link_was_lost_is_told_with_its_return(
    sensor, make_client, blocks, clock, send
):
    client = make_client(now_ns=clock.now_ns, rate_hz=100.0)
    sensor.write(b'\n')
    send(10)
    sensor.unplug()
    wait_until(lambda: not client.health().is_connected)
    clock.ahead_ns -= 5 * SECOND_NS
    sensor.plug_in()
    wait_until(lambda: client.health().reconnects == 1)
    sensor.write(b'\n')
    send(1)
    assert blocks[-1].status & ~StrainStatus.RESYNCHRONISED == (
        StrainStatus.RECONNECTED | StrainStatus.CLOCK_STEP
    )
    assert client.health().restarts == 0


# -- the port ------------------------------------------------------------------------------


def test_a_closed_port_takes_no_bytes(sensor):
    transport = SerialTransport(sensor.port, 115200)
    transport.close()
    transport.close()
    with pytest.raises(LinkError):
        transport.write(b'x')


def test_the_serial_number_is_that_of_the_adapter_behind_the_name(sensor, monkeypatch):
    adapters = [
        SimpleNamespace(device='/dev/ttyUSB9', serial_number='other'),
        SimpleNamespace(device=os.path.realpath(sensor.port), serial_number='A50285BI'),
    ]
    monkeypatch.setattr(module.list_ports, 'comports', lambda: adapters)
    assert find_serial_number(sensor.port) == 'A50285BI'
    adapters[1].serial_number = None
    assert find_serial_number(sensor.port) == find_serial_number('/dev/absent') == ''
