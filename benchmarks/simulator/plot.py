# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Draw the simulator's error against its time per trial, for docs/benchmarks.md.

Usage: ./tactile run python -m benchmarks.simulator.plot [--quick] [FILE]
"""

from __future__ import annotations

import argparse
from pathlib import Path
import sys

import matplotlib
import numpy as np

from benchmarks.simulator.mujoco_twin import MujocoMissingError
from benchmarks.simulator.schemes import BOUND_PERCENT, Choice, measure_choices
from benchmarks.simulator.twin import measure_our_speeds, measure_twin_speeds, Speed
from tactile_sim.physics.fast_trials import STEPS_PER_SAMPLE
from tactile_sim.physics.finger.steps import BDF2, EULER

matplotlib.use('Agg')
from matplotlib.axes import Axes
import matplotlib.pyplot as plt

FILE = Path(__file__).resolve().parents[2] / 'docs' / 'images' / 'simulator_speed_error.png'
STYLES = {
    EULER.name: ('#b8860b', 's', 'first order (Euler)'),
    BDF2.name: ('#1f4e79', 'o', 'second order (BDF2)'),
}
NEAR_TICKS_MS = (0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0)
TICKS_MS = (0.1, 0.3, 1, 3, 10, 30, 100, 300)
TICKS_PERCENT = (0.1, 0.2, 0.5, 1, 2, 5, 10)


def main() -> int:
    """Measure and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('file', type=Path, nargs='?', default=FILE)
    parser.add_argument('--quick', action='store_true', help='fewer rounds; in MuJoCo one plate')
    arguments = parser.parse_args()
    choices = measure_choices(arguments.quick)
    ours = measure_our_speeds(arguments.quick)
    try:
        twins = measure_twin_speeds(arguments.quick)
    except MujocoMissingError as error:
        sys.stderr.write(f'without the points of MuJoCo: {error}\n')
        twins = []
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 6.4), layout='constrained')
    _draw_choices(left, choices)
    _draw_twins(right, ours, twins)
    for axes in (left, right):
        axes.set_xscale('log')
        axes.set_yscale('log')
        ticks_ms = NEAR_TICKS_MS if axes is left else TICKS_MS
        axes.set_xticks(ticks_ms, [f'{tick:g}' for tick in ticks_ms])
        axes.set_yticks(TICKS_PERCENT, [f'{tick:g}' for tick in TICKS_PERCENT])
        axes.minorticks_off()
        axes.grid(color='0.9')
        axes.set_xlabel('time per trial on one core [ms]')
        axes.legend(fontsize=8, frameon=False, loc='upper center', bbox_to_anchor=(0.5, -0.13))
    _widen(left, 1.15)
    _widen(right, 4.0)
    arguments.file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(arguments.file, dpi=130)
    return 0


def _widen(axes: Axes, factor: float) -> None:
    """Make room for labels."""
    low, high = axes.get_xlim()
    axes.set_xlim(low / 1.15, high * factor)


def _draw_choices(axes: Axes, choices: list[Choice]) -> None:
    for scheme in (EULER, BDF2):
        colour, marker, label = STYLES[scheme.name]
        some = [choice for choice in choices if choice.scheme == scheme]
        times_ms = [1e3 * choice.trial_s for choice in some]
        for name, style in (('tension_percent', ':'), ('sensed_percent', '-')):
            errors = [np.quantile(getattr(choice.errors, name), 0.95) for choice in some]
            what = {'tension_percent': 'tension', 'sensed_percent': 'what the sensor gets'}[name]
            axes.plot(
                times_ms,
                errors,
                style,
                color=colour,
                marker=marker,
                markersize=4,
                label=f'{label}: {what}',
            )
            for choice, time_ms, error in zip(some, times_ms, errors, strict=True):
                if scheme == BDF2 and name == 'sensed_percent':
                    _label(axes, f'{choice.steps}', time_ms, error, 'right')
                if scheme == BDF2 and choice.steps == STEPS_PER_SAMPLE:
                    _circle(axes, time_ms, error, name == 'sensed_percent')
    axes.axhline(BOUND_PERCENT, color='0.5', lw=0.8, ls='--', label='bound of the default')
    axes.set_ylabel('error that 95 of 100 trials stay below\n[% of the alternating part]')
    axes.set_title('Drawn texture trials; numbers: steps a sample', fontsize=10)


def _draw_twins(axes: Axes, ours: list[Speed], twins: list[Speed]) -> None:
    for name, speeds, colour, marker in (
        ('this simulator, in a batch', ours, STYLES[BDF2.name][0], 'o'),
        ('MuJoCo with contact in Python', twins, '#8b1a1a', 'D'),
    ):
        if not speeds:
            continue
        for what, style in (('tension', ':'), ('what the sensor gets', '-')):
            errors = [s.percent if what == 'tension' else s.sensed_percent for s in speeds]
            times_ms = [1e3 * speed.trial_s for speed in speeds]
            axes.plot(
                times_ms,
                errors,
                style,
                color=colour,
                marker=marker,
                markersize=4,
                label=f'{name}: {what}',
            )
            for speed, time_ms, error in zip(speeds, times_ms, errors, strict=True):
                if speeds is ours and style == '-':
                    _label(axes, speed.short, time_ms, error, 'right')
                if speeds is twins and style == ':':
                    _label(axes, speed.short, time_ms, error, 'left')
        if speeds is ours:
            _circle(axes, 1e3 * ours[0].trial_s, ours[0].percent, False)
            _circle(axes, 1e3 * ours[0].trial_s, ours[0].sensed_percent, True)
    if twins:
        axes.plot(
            [1e3 * (speed.alone_s or 0.0) for speed in twins],
            [speed.sensed_percent for speed in twins],
            '--',
            color='#d98880',
            marker='d',
            markersize=4,
            label="MuJoCo's own steps alone",
        )
    axes.set_ylabel('largest error over four plates\n[% of the alternating part]')
    axes.set_title('One trial a plate; the same scene in MuJoCo, with its step', fontsize=10)


def _label(axes: Axes, text: str, time_ms: float, error: float, side: str) -> None:
    offset = {'right': (-7, -7), 'left': (7, 2)}[side]
    axes.annotate(text, (time_ms, error), offset, textcoords='offset points', fontsize=8, ha=side)


def _circle(axes: Axes, time_ms: float, error: float, named: bool) -> None:
    axes.plot(
        time_ms,
        error,
        'o',
        markersize=11,
        markerfacecolor='none',
        markeredgecolor='k',
        label='the default' if named else None,
    )


if __name__ == '__main__':
    sys.exit(main())
