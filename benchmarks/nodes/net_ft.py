# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A Net F/T from datagrams to blocks: pynetft against whole arrays."""

from __future__ import annotations

from contextlib import ExitStack
import multiprocessing
from pathlib import Path
import sys
import time
from typing import Any

import numpy as np

from benchmarks.measuring import Report, Row
from tendon_sensor_driver.ati import net_ft_links
from tendon_sensor_driver.ati.net_ft import NetFtClient
from tendon_sensor_driver.records import TendonSensorConfig

sys.path.append(str(Path(__file__).parents[2] / 'src/testing'))
from net_ft_box import NetFtBox
from net_ft_device import HOST, NetFtDevice

STARTUP_S = 20.0
SETTLE_S = 0.5
CASES = (  # name, rate [Hz], samples in a block, rate up to which pynetft is taken [Hz]
    ('pynetft, 60 Hz, 1 a block', 60.0, 1, 1e9),
    ('pynetft, 1 kHz, 10 a block', 1000.0, 10, 1e9),
    ('arrays, 1 kHz, 10 a block', 1000.0, 10, 0.0),
    ('pynetft, 7 kHz, 70 a block', 7000.0, 70, 1e9),
    ('arrays, 7 kHz, 70 a block', 7000.0, 70, 0.0),
)


def run_net_ft(quick: bool) -> Report:
    """Measure the client's processor time and loss at a simulated box."""
    rows = [_measure(*case, 2.0 if quick else 5.0) for case in CASES]
    return Report(
        'Net F/T: datagrams to blocks, without a node',
        'none: processor time of the process that holds the client alone; the simulated box is '
        'another one. The driver takes pynetft up to '
        f'{net_ft_links.PYNETFT_MOST_HZ:g} Hz and arrays above',
        'samples lost',
        rows,
    )


def _measure(case: str, rate_hz: float, samples_per_block: int, most_hz: float, s: float) -> Row:
    processes = multiprocessing.get_context('spawn')
    with ExitStack() as stack:
        ports, is_over = processes.Queue(), processes.Event()
        box = processes.Process(target=_serve_box, args=(ports, is_over))
        box.start()
        stack.callback(box.join, STARTUP_S)
        stack.callback(is_over.set)
        rdt_port, http_port = ports.get(timeout=STARTUP_S)
        results = processes.Queue()
        config = TendonSensorConfig(
            sensor='net_ft',
            host=HOST,
            rdt_port=rdt_port,
            http_port=http_port,
            rate_hz=rate_hz,
            samples_per_block=samples_per_block,
        )
        client = processes.Process(target=_read_box, args=(config, most_hz, s, results))
        client.start()
        stack.callback(client.join, STARTUP_S)
        load, samples, lost = results.get(timeout=STARTUP_S + s)
    more = {'us a sample': 1e6 * load * s / samples, 'CPU of a core %': 100 * load}
    return Row(case, None, lost, 0, more=more)


def _serve_box(ports: Any, is_over: Any) -> None:
    force_n = 5.0 + np.sin(np.arange(7000) / 100.0)
    with NetFtDevice(NetFtBox(force_n)) as device:
        ports.put((device.rdt_port, device.http_port))
        is_over.wait()


def _read_box(config: TendonSensorConfig, most_hz: float, seconds: float, results: Any) -> None:
    net_ft_links.PYNETFT_MOST_HZ = most_hz
    with NetFtClient(config, lambda block: None, time.time_ns) as client:
        time.sleep(SETTLE_S)
        before, used_s, wall_s = client.health(), time.process_time(), time.perf_counter()
        time.sleep(seconds)
        used_s, wall_s = time.process_time() - used_s, time.perf_counter() - wall_s
        after = client.health()
    results.put((used_s / wall_s, after.readings - before.readings, after.lost_samples))
