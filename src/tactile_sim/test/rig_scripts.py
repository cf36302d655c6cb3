# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scripts of driver commands, mountings and faults, which are run on a simulated rig.

`recorded_rigs.npz` contains the results of the scripts at commit c3a91d4a. At that commit, the
rig advanced by single steps and polled every line after each step. To record the results again,
run this file in a checkout of the commit that is the reference.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

from dynamixel_packets import encode_instruction
import numpy as np

from linear_guide_driver.dynamixel import registers as known
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.devices.faults import GuideLine, read_request, SensorLine, TendonLine
from tactile_sim.rig import PalpationRig, STEP_S

RECORDED = Path(__file__).with_name('recorded_rigs.npz')
LOOK_STEPS = 50
"""Number of steps between two reads of the true state."""

_M_PER_COUNT = default_catalogue().rig().tendon.m_per_count
TRUTH = (
    'guide_position_m',
    'tendon_displacement_m',
    'bend_rad',
    'tension_n',
    'contact_force_n',
)


class Script(NamedTuple):
    """Commands by step number: (device, bytes), ('mount', names) or ('fault', request)."""

    seed: int
    steps: int
    commands: dict[int, list[tuple[str, object]]]


class Told(NamedTuple):
    """Result of a script: bytes sent by the devices (step, device, data), and true states."""

    said: list[tuple[int, str, bytes]]
    truth: np.ndarray


class _Writer:
    def __init__(self, seed):
        self._seed = seed
        self._commands = defaultdict(list)

    def at(self, time_s, device, what):
        self._commands[round(time_s / STEP_S)].append((device, what))

    def guide(self, time_s, text):
        self.at(time_s, 'guide', text)

    def write(self, time_s, register, value):
        data = value.to_bytes(register.size, 'little', signed=register.is_signed)
        self.at(
            time_s,
            'tendon',
            encode_instruction(1, 3, register.address.to_bytes(2, 'little') + data),
        )

    def read(self, time_s, register=known.HARDWARE_ERROR, length=60):
        where = register.address.to_bytes(2, 'little') + length.to_bytes(2, 'little')
        self.at(time_s, 'tendon', encode_instruction(1, 2, where))

    def fault(self, time_s, device, kind, **options):
        self.at(time_s, 'fault', {'device': device, 'kind': kind, **options})

    def mount(self, time_s, *names):
        self.at(time_s, 'mount', names)

    def prepare(self, current=300, speed=25, watchdog=0):
        self.guide(0.004, b'$24=1000\n$25=6000\n')
        self.guide(0.01, b'$H\n')
        for register, value in (
            (known.OPERATING_MODE, 5),
            (known.GOAL_CURRENT, current),
            (known.PROFILE_VELOCITY, speed),
            (known.BUS_WATCHDOG, watchdog),
            (known.TORQUE_ENABLE, 1),
        ):
            self.write(0.02, register, value)

    def pull(self, time_s, displacement_m):
        self.write(time_s, known.GOAL_POSITION, 2048 + round(displacement_m / _M_PER_COUNT))

    def poll(self, start_s, end_s, servo_s=0.05, guide_s=0.1):
        for time_s in np.arange(start_s, end_s, servo_s):
            self.read(time_s)
        for time_s in np.arange(start_s + 0.003, end_s, guide_s):
            self.guide(time_s, b'?')

    def end(self, time_s):
        return Script(self._seed, round(time_s / STEP_S), dict(self._commands))


def _write_texture():
    """Return a script of two glides over plates, with a pause in the second glide."""
    script = _Writer(1)
    script.prepare(speed=60, watchdog=15)
    script.poll(0.05, 11.0)
    script.mount(3.3, 'texture', 'R1', 'abduction')
    script.guide(3.4, b'G1X-140F6000\n')
    script.pull(4.5, 0.0075)
    script.guide(5.6, b'G1X-120F900\n')
    script.pull(7.1, 0.0)
    script.mount(7.9, 'texture', 'T2', 'flexion', (0, 1, 2))
    script.pull(8.0, 0.0054)
    script.guide(8.6, b'G1X-140F1800\nG4P0.1\nG1X-139F300\n')
    script.guide(8.9, b'!')
    script.guide(9.2, b'~')
    # The polls have ended at 11 s, so the servo's bus watchdog stops this motion.
    script.pull(11.1, 0.0)
    return script.end(12.5)


def _write_stiffness():
    """Return a script of presses on objects, in which the servo stalls and loses its torque."""
    script = _Writer(2)
    script.prepare(speed=50)
    script.mount(3.0, 'stiffness', 'sponge', 'flexion')
    script.guide(3.1, b'G1X-140F6000\n')
    script.pull(4.6, 0.0060)
    script.pull(6.2, 0.0)
    script.mount(7.6, 'stiffness', 'sponge', 'abduction')
    script.write(7.7, known.GOAL_CURRENT, 12)
    script.pull(7.8, 0.012)
    script.write(8.6, known.GOAL_CURRENT, 200)
    script.poll(8.7, 9.0, 0.01)
    script.write(9.3, known.TORQUE_ENABLE, 0)
    return script.end(11.5)


def _write_faults():
    """Return a script with faults of all three devices during a pull and moves of the guide."""
    script = _Writer(3)
    script.prepare(watchdog=30)
    script.poll(0.05, 14.0)
    script.mount(3.1, 'stiffness', 'sponge', 'flexion', (3, 0, 0))
    script.fault(3.2, 'sensor', 'burst', period_s=0.05, duration_s=0.72)
    script.fault(3.3, 'tendon', 'noise', duration_s=0.3)
    script.fault(3.35, 'tendon', 'corrupt', share=0.4, duration_s=0.4)
    script.fault(3.4, 'guide', 'garbage', share=0.5, duration_s=0.5)
    script.guide(3.5, b'G1X-140F6000\n')
    script.pull(3.6, 0.005)
    script.fault(4.2, 'sensor', 'menu', duration_s=0.31)
    script.fault(4.6, 'sensor', 'unplug', duration_s=0.23)
    script.fault(5.7, 'sensor', 'drop', count=3)
    script.fault(5.9, 'sensor', 'split', share=0.2, duration_s=0.3)
    script.fault(6.0, 'sensor', 'stuck', duration_s=0.4)
    script.fault(6.5, 'sensor', 'saturate', duration_s=0.2)
    script.fault(6.8, 'guide', 'wrong_baud', duration_s=0.2)
    script.fault(7.1, 'guide', 'stall')
    script.guide(7.15, b'G1X-130F600\nG4P0.05\n')
    script.guide(7.9, b'~')
    script.guide(8.4, b'G1X-100F600\n')
    script.fault(8.8, 'guide', 'alarm')
    script.guide(9.6, b'\x18')
    script.fault(9.9, 'tendon', 'overheat', temperature_c=90.0, duration_s=0.4)
    script.fault(10.6, 'tendon', 'restart')
    script.fault(11.0, 'guide', 'restart')
    script.at(12.0, 'sensor', b'x')
    script.at(12.2, 'sensor', b'x')
    script.guide(12.4, b'$X\nG91G1X5F300\n')
    script.guide(12.5, b'\x18')
    script.fault(13.0, 'sensor', 'restart')
    return script.end(14.0)


SCRIPTS = {
    'texture': _write_texture(),
    'stiffness': _write_stiffness(),
    'faults': _write_faults(),
}


def make_lines(rig, seed):
    """Return the serial lines between devices and drivers, as `ServedRig` creates them."""
    return {
        'guide': GuideLine(rig.guide, seed),
        'tendon': TendonLine(rig.tendon, seed + 1),
        'sensor': SensorLine(rig.sensor, seed + 2),
    }


def obey(rig, lines, step, commands):
    """Execute the commands of a step; return the replies of the devices to them."""
    said = []
    now_s = step * STEP_S
    for kind, what in commands:
        if kind == 'mount':
            rig.mount(*what[:3], *what[3:])
        elif kind == 'fault':
            request = read_request(what)
            lines[request.device].begin(request, now_s)
        else:
            said.append((step, kind, lines[kind].receive(what, now_s)))
    return said


def run_by_steps(script):
    """Run a script step by step, and poll every line after each step."""
    rig = PalpationRig(script.seed)
    lines = make_lines(rig, script.seed)
    said, truth = [], []
    for step in range(1, script.steps + 1):
        rig.advance(step * STEP_S)
        said += obey(rig, lines, step, script.commands.get(step, ()))
        said += [(step, name, line.poll(step * STEP_S)) for name, line in lines.items()]
        if step % LOOK_STEPS == 0:
            state = rig.read_truth()
            truth.append([state[name] for name in TRUTH])
    return Told([entry for entry in said if entry[2]], np.array(truth))


def run_by_events(script):
    """Run a script directly to each next command or byte, and poll only lines with output."""
    rig = PalpationRig(script.seed)
    lines = make_lines(rig, script.seed)
    commands = sorted(script.commands)
    looks = list(range(LOOK_STEPS, script.steps + 1, LOOK_STEPS))
    said, truth = [], []
    while looks:
        due_s = min(line.due_s for line in lines.values())
        now_s = min(
            rig.step_time_s(due_s), *(some[0] * STEP_S for some in (commands, looks) if some)
        )
        assert rig.advance(now_s) == now_s
        step = round(now_s / STEP_S)
        if commands and step == commands[0]:
            said += obey(rig, lines, step, script.commands[commands.pop(0)])
        said += [
            (step, name, line.poll(now_s)) for name, line in lines.items() if line.due_s <= now_s
        ]
        if step == looks[0]:
            looks.pop(0)
            state = rig.read_truth()
            truth.append([state[name] for name in TRUTH])
    return Told([entry for entry in said if entry[2]], np.array(truth))


def load_recorded(name):
    """Return the recorded result of a script."""
    with np.load(RECORDED) as archive:
        steps, devices, sizes, data, truth = (
            archive[f'{name}_{part}'] for part in ('steps', 'devices', 'sizes', 'data', 'truth')
        )
    ends = np.cumsum(sizes)
    whole = data.tobytes()
    said = [
        (int(step), str(device), whole[end - size : end])
        for step, device, size, end in zip(steps, devices, sizes, ends, strict=True)
    ]
    return Told(said, truth)


def _record():
    arrays = {}
    for name, script in SCRIPTS.items():
        told = run_by_steps(script)
        steps, devices, parts = zip(*told.said, strict=True)
        arrays |= {
            f'{name}_steps': np.array(steps, dtype=np.int32),
            f'{name}_devices': np.array(devices),
            f'{name}_sizes': np.array([len(part) for part in parts], dtype=np.int32),
            f'{name}_data': np.frombuffer(b''.join(parts), dtype=np.uint8),
            f'{name}_truth': told.truth,
        }
    np.savez_compressed(RECORDED, **arrays)


if __name__ == '__main__':
    _record()
