# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Processor time of the SIMULATED rig while it is polled at the rates of the drivers."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import json
import os
from pathlib import Path
import statistics
import subprocess
import sys
import tempfile
import time
from typing import Any, NamedTuple

from benchmarks.measuring import (
    find_other_checkout,
    OTHER_CHECKOUT,
    Ratio,
    read_processor_s,
    Report,
    Row,
)
from linear_guide_driver.dynamixel import registers as known
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.devices.dynamixel import compute_crc, HEADER, READ, WRITE

STATE_BLOCK = (known.BUS_WATCHDOG.address, 60)
DEVICES = ('guide', 'tendon', 'sensor')
RUN = 'from tactile_sim.rig_server import main; import sys; sys.exit(main())'
HIDE_NUMBA = "import sys; sys.modules['numba'] = None; "


class Rates(NamedTuple):
    """Rates at which the drivers poll servo and guide [1/s]."""

    servo_hz: float
    guide_hz: float


REST, MOTION = Rates(25.0, 5.0), Rates(60.0, 10.0)


class Case(NamedTuple):
    """Number of rigs in one process, whether the rig is in a glide, and whether numba is used."""

    rigs: int
    glides: bool
    has_numba: bool


CASES = {
    'one rig at rest': Case(1, False, True),
    'one rig in a glide': Case(1, True, True),
    'five rigs at rest, one process': Case(5, False, True),
    'one rig at rest, without numba': Case(1, False, False),
    'one rig in a glide, without numba': Case(1, True, False),
}


def encode_packet(code: int, parameters: bytes) -> bytes:
    """Encode an instruction to the servo with ID 1.

    Byte stuffing is left out, because none of the packets needs it.
    """
    packet = HEADER + b'\1' + (len(parameters) + 3).to_bytes(2, 'little')
    packet += bytes([code]) + parameters
    return packet + compute_crc(packet).to_bytes(2, 'little')


def encode_write(register: known.Register, value: int) -> bytes:
    """Encode an instruction to write a register."""
    data = value.to_bytes(register.size, 'little', signed=register.is_signed)
    return encode_packet(WRITE, register.address.to_bytes(2, 'little') + data)


POLL_SERVO = encode_packet(READ, b''.join(value.to_bytes(2, 'little') for value in STATE_BLOCK))


class Rigs:
    """A process with simulated rigs, whose ports are polled as the drivers would poll them."""

    def __init__(self, case: Case, checkout: Path | None, folder: Path) -> None:
        environment = dict(os.environ)
        if checkout is not None:
            packages = [str(path.parent) for path in checkout.glob('src/*/setup.py')]
            before = environment.get('PYTHONPATH', '')
            environment['PYTHONPATH'] = os.pathsep.join([*packages, before])
        links = [str(folder / str(i)) for i in range(case.rigs)]
        program = RUN if case.has_numba else HIDE_NUMBA + RUN
        self.process = subprocess.Popen(
            [sys.executable, '-c', program, '--links', *links],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._ports: list[dict[str, int]] = []
        for _ in links:
            names = self._read()
            flags = os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY
            self._ports.append({name: os.open(names[name], flags) for name in DEVICES})

    def _read(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError('the simulated rig did not start; its error is above')
        answer: dict[str, Any] = json.loads(line)
        return answer

    def mount(self, *names: str) -> None:
        """Mount a plate or object under the finger of the first rig."""
        assert self.process.stdin is not None
        keys = ('protocol', 'object', 'contact')
        self.process.stdin.write(
            json.dumps({'mount': dict(zip(keys, names, strict=True))}).encode() + b'\n'
        )
        self.process.stdin.flush()
        assert self._read().get('ok')

    def send(self, device: str, data: bytes) -> None:
        """Send bytes to a device of the first rig."""
        os.write(self._ports[0][device], data)

    def poll(self, duration_s: float, rates: Rates) -> None:
        """Poll the devices of all rigs at the rates of the drivers, and read the replies."""
        end_s = time.monotonic() + duration_s
        servo_s = guide_s = time.monotonic()
        while (now_s := time.monotonic()) < end_s:
            for ports in self._ports:
                if now_s >= servo_s:
                    os.write(ports['tendon'], POLL_SERVO)
                if now_s >= guide_s:
                    os.write(ports['guide'], b'?')
                for file in ports.values():
                    with contextlib.suppress(BlockingIOError):
                        os.read(file, 65536)
            if now_s >= servo_s:
                servo_s += 1 / rates.servo_hz
            if now_s >= guide_s:
                guide_s += 1 / rates.guide_hz
            time.sleep(max(min(servo_s, guide_s, end_s) - time.monotonic(), 0.0))

    def cpu_s(self) -> float:
        """Return the processor time that the process has used until now [s]."""
        return read_processor_s(self.process.pid)

    def close(self) -> None:
        """End the process by closing its standard input."""
        assert self.process.stdin is not None
        for ports in self._ports:
            for file in ports.values():
                os.close(file)
        self.process.stdin.close()
        self.process.wait()


@contextlib.contextmanager
def run_rigs(case: Case, checkout: Path | None) -> Iterator[Rigs]:
    """Start rigs and bring them to the initial state of the case."""
    with tempfile.TemporaryDirectory(prefix='tactile_rigs_') as folder:
        rigs = Rigs(case, checkout, Path(folder))
        try:
            rigs.poll(1.0, REST)
            if case.glides:
                _begin_glide(rigs)
            yield rigs
        finally:
            rigs.close()


def _begin_glide(rigs: Rigs) -> None:
    """Home the guide, press the finger on a plate by pulling the tendon, and start a glide."""
    rigs.send('guide', b'$24=1000\n$25=6000\n$H\n')
    for register, value in (
        (known.OPERATING_MODE, known.MODE_CURRENT_BASED_POSITION),
        (known.GOAL_CURRENT, 300),
        (known.PROFILE_VELOCITY, 60),
        (known.TORQUE_ENABLE, 1),
    ):
        rigs.send('tendon', encode_write(register, value))
    rigs.poll(3.0, MOTION)
    rigs.mount('texture', 'R1', 'flexion')
    rigs.send('guide', b'G1X-140F6000\n')
    rigs.poll(1.5, MOTION)
    drive = default_catalogue().rig().tendon
    goal = drive.slack_count + round(0.0054 / drive.m_per_count)
    rigs.send('tendon', encode_write(known.GOAL_POSITION, goal))
    rigs.poll(1.5, MOTION)
    rigs.send('guide', b'G1X-70F900\n')
    rigs.poll(0.2, MOTION)


def measure_share(case: Case, checkout: Path | None, duration_s: float) -> float:
    """Return the processor time of the process of the rigs, divided by wall time."""
    with run_rigs(case, checkout) as rigs:
        before_s, started_s = rigs.cpu_s(), time.monotonic()
        rigs.poll(duration_s, MOTION if case.glides else REST)
        return (rigs.cpu_s() - before_s) / (time.monotonic() - started_s)


def run_rig_cpu(quick: bool) -> Report:
    """Measure every case, alternately with another checkout if `OTHER_CHECKOUT` is set."""
    other = find_other_checkout()
    rounds, duration_s = (2, 2.0) if quick else (4, 4.0)
    rows = []
    for name, case in CASES.items():
        shares: list[tuple[float, float | None]] = []
        for _ in range(rounds):
            # The other checkout is always measured with numba, because it may not work without.
            theirs = None
            if other is not None:
                theirs = measure_share(case._replace(has_numba=True), other, duration_s)
            shares.append((measure_share(case, None, duration_s), theirs))
        ours = statistics.median(share for share, _ in shares)
        more = {'% of a core': 100 * ours}
        ratio = None
        ratios = [share / theirs for share, theirs in shares if theirs is not None]
        if ratios:
            more['% of the other'] = 100 * statistics.median(b for _, b in shares if b is not None)
            low, median, high = statistics.quantiles(ratios, n=4)
            ratio = Ratio(median, low, high)
        rows.append(Row(name, ratio, more=more))
    return Report(
        'Processor time of the SIMULATED rig, polled as by its drivers',
        f'the rig of the checkout in {OTHER_CHECKOUT}, with numba, measured alternately'
        if other
        else '',
        '',
        rows,
    )
