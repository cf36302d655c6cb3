# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Digital F/T client against a simulated device, over real pseudo-terminals."""

import contextlib
import os
import select
import threading
import time
import tty

from digital_ft_device import DigitalFtDevice
import numpy as np
import pytest

from tactile_testing.waiting import wait_until
from tendon_sensor_driver import LinkError, StrainStatus, TendonSensorConfig
from tendon_sensor_driver.ati import digital_ft, digital_ft_link, digital_ft_stream
from tendon_sensor_driver.ati.digital_ft import DigitalFtClient


class Port:
    """A device on a pty, behind a symbolic link that outlives unplugging."""

    def __init__(self, link, device):
        self.link, self.device = link, device
        self.lock = threading.Lock()
        self.begun_s = time.monotonic()
        self.spoil = lambda data: data
        self.plug_in()

    def plug_in(self):
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        os.symlink(os.ttyname(self.slave), self.link)
        self.stopping = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def unplug(self):
        if self.stopping.is_set():
            return
        os.unlink(self.link)
        self.stopping.set()
        self.thread.join()
        os.close(self.master)
        os.close(self.slave)

    def run(self):
        while not self.stopping.is_set():
            has_input = select.select([self.master], [], [], 0.003)[0]
            now_s = time.monotonic() - self.begun_s
            with self.lock:
                output = (
                    self.device.receive(os.read(self.master, 4096), now_s) if has_input else b''
                )
                output += self.spoil(self.device.poll(now_s))
            if output:
                with contextlib.suppress(BlockingIOError):
                    os.write(self.master, output)


@pytest.fixture
def port(tmp_path, monkeypatch):
    monkeypatch.setattr(digital_ft, '_DEAD_S', 0.3)
    monkeypatch.setattr(digital_ft_stream, '_FIRST_MEASUREMENT_S', 0.25)
    device = DigitalFtDevice(lambda time_s: 7.0 + time_s, np.random.default_rng(0))
    port = Port(str(tmp_path / 'sensor'), device)
    yield port
    port.unplug()


@pytest.fixture
def blocks():
    return []


@pytest.fixture
def client(port, blocks):
    config = TendonSensorConfig(
        sensor='digital_ft', port=port.link, baud=1_250_000, rate_hz=60.0, scale=-1.0
    )
    with DigitalFtClient(config, blocks.append, time.time_ns) as client:
        wait_until(lambda: len(blocks) > 5)
        yield client


def check_numbers(blocks):
    expected = end_ns = 0
    for block in blocks:
        assert block.sequence == expected + block.lost_before
        assert block.stamp_ns > end_ns
        expected, end_ns = block.sequence + len(block.tension_n), block.stamp_ns


def test_the_calibration_of_the_device_makes_newtons_of_its_gauges(port, client, blocks):
    wait_until(lambda: len(blocks) > 30)
    client.close()
    check_numbers(blocks)
    tension_n = np.concatenate([block.tension_n for block in blocks])
    assert (-tension_n > 7.0).all()
    assert (np.diff(tension_n) < 0.01).all()  # rises by 1 N/s: no sample comes twice
    assert np.diff(tension_n).mean() == pytest.approx(-1 / 60, rel=0.3)
    assert blocks[0].wrench.shape == (1, 6)
    assert np.abs(blocks[0].wrench[:, [0, 1, 3, 4, 5]]).max() < 0.1
    assert client.identity == 'FT000001'
    assert client.health().rate_hz == pytest.approx(60, rel=0.3)
    assert all(StrainStatus.HOST_TIME in block.status for block in blocks)
    assert all(block.stamp_error_s < 0 for block in blocks)


def test_a_stream_left_by_a_crashed_run_is_stopped_first(port, blocks):
    port.device.is_streaming = True
    config = TendonSensorConfig(sensor='digital_ft', port=port.link, baud=1_250_000)
    with DigitalFtClient(config, blocks.append, time.time_ns):
        wait_until(lambda: len(blocks) > 3)
    wait_until(lambda: not port.device.is_streaming)  # closing stops it


def test_damage_is_dropped_counted_and_invents_nothing(port, client, blocks):
    generator = np.random.default_rng(3)
    damage = iter([b'\0' * 40, generator.bytes(100), generator.bytes(5)])
    with port.lock:
        port.spoil = lambda data: next(damage, b'') + data[: len(data) // 13 * 13]
    wait_until(lambda: client.health().lost_samples >= 1)
    count = len(blocks)
    wait_until(lambda: len(blocks) > count + 10)
    client.close()
    check_numbers(blocks)
    tension_n = np.concatenate([block.tension_n for block in blocks])
    assert (np.diff(-tension_n) > -0.02).all()
    assert StrainStatus.RESYNCHRONISED in {bit for block in blocks for bit in block.status}
    assert client.health().rejected_lines > 0


def test_an_error_is_marked_and_told_in_words(port, client, blocks):
    with port.lock:
        port.device.status = 1 << 5
    wait_until(lambda: client.health().device_status == 'supply too low')
    count = len(blocks)
    wait_until(lambda: len(blocks) > count + 3)
    assert StrainStatus.DEVICE_ERROR in blocks[-1].status
    with port.lock:
        port.device.status = 0
    wait_until(lambda: client.health().device_status == '')
    assert StrainStatus.DEVICE_ERROR not in client.health().status


def test_it_comes_back_after_unplugging(port, client, blocks):
    port.unplug()
    wait_until(lambda: not client.health().is_connected)
    with port.lock:
        port.device.is_streaming = False
    count = len(blocks)
    port.plug_in()
    wait_until(lambda: len(blocks) > count + 3)
    assert StrainStatus.RECONNECTED in blocks[count].status
    assert blocks[count].lost_before > 0
    client.close()
    check_numbers(blocks)


def test_a_silent_device_is_noticed(port, client, blocks):
    with port.lock:
        port.device.is_streaming = False
    wait_until(lambda: not client.health().is_connected)
    wait_until(lambda: client.health().is_connected)  # and told to stream again
    assert client.health().reconnects == 1


def test_an_empty_slot_is_refused_with_the_remedy(port):
    config = TendonSensorConfig(sensor='digital_ft', port=port.link, calibration_slot=3)
    with pytest.raises(LinkError, match='choose another slot'):
        DigitalFtClient(config, print, time.time_ns).open()


def test_something_else_on_the_port_is_told(monkeypatch):
    monkeypatch.setattr(digital_ft_link, '_ANSWER_TIMEOUT_S', 0.02)
    master, slave = os.openpty()
    tty.setraw(slave)
    config = TendonSensorConfig(sensor='digital_ft', port=os.ttyname(slave))
    with pytest.raises(LinkError, match='check power, wiring and the parameter "baud"'):
        DigitalFtClient(config, print, time.time_ns).open()
    os.close(master)
    os.close(slave)
