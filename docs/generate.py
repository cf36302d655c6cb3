# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Update the pictures and tables of the documentation: ./tactile run python docs/generate.py."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from constants import build_tables, replace_tables
from interfaces import build_page
import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from parameters import replace_all_tables

from tactile_bringup.trial_protocols import TrialConfig
from tactile_features.feature_sets.stiffness import compute_regression
from tactile_lab.simulation.simulated_trials import SimulationPlan
import tactile_sim
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics import layout as at
from tactile_sim.physics.equations import compute_curve
from tactile_sim.physics.motion import Move, Timeline
from tactile_sim.physics.scene import build_scene, Scene
from tactile_sim.physics.trials import simulate_motion
from tactile_sim.physics.variation import Variation

mpl.use('Agg')

from matplotlib import pyplot as plt
from phase_picture import draw_phases
from rig_picture import draw_plates, draw_rig
from trial_picture import plot_simulated_trial

FloatArray = NDArray[np.float64]

IMAGES = Path(__file__).parent / 'images'
PAPER_TENSIONS_N = {'flexion': (0, 5, 10, 15), 'abduction': (0, 1, 2, 3)}
PULL_M = {'flexion': 0.0049, 'abduction': 0.0074}
PAPER_SLOPE_N_S, PAPER_INTERCEPT_N, PAPER_CORRELATION = -0.90, 12.62, -0.99


def main() -> None:
    """Update all pictures and tables."""
    IMAGES.mkdir(exist_ok=True)
    page = IMAGES.parent / 'simulator_constants.md'
    tables = build_tables(Path(tactile_sim.__file__).parent / 'config')
    page.write_text(replace_tables(page.read_text('utf-8'), 'constants', tables), 'utf-8')
    page = IMAGES.parent / 'parameters.md'
    page.write_text(replace_all_tables(page.read_text('utf-8')), 'utf-8')
    interfaces = build_page(IMAGES.parents[1] / 'src' / 'tactile_msgs')
    (IMAGES.parent / 'interfaces.md').write_text(interfaces, 'utf-8')
    draw_finger(IMAGES / 'simulated_finger.png')
    draw_glide(IMAGES / 'simulated_glide.png')
    plan = SimulationPlan('texture', 'flexion', 1, 1)
    plot_simulated_trial(IMAGES / 'simulated_trial.png', plan, TrialConfig(), Catalogue(None))
    draw_phases(IMAGES / 'detected_phases.png')
    draw_plates(IMAGES / 'plates.png')
    draw_rig(IMAGES / 'rig.png')


def find_free_shapes(contact: str, tensions_n: tuple[int, ...]) -> list[FloatArray]:
    """Return the bending modes (shape (3,)) of a finger at rest without contact, per tension."""
    scene = build_scene('stiffness', 'none', contact)
    pulls_m = np.linspace(0.0, 0.03, 3000)
    # All displacements of the tendon are simulated in one batch. Each trial in the batch has
    # another zero of the tendon, which has the same effect as a displacement.
    variation = dataclasses.replace(Variation.none(len(pulls_m)), tendon_zero_m=-pulls_m)
    start = scene.compute_inputs(np.zeros(1), np.array([scene.guide_m]))[0]
    state = scene.start_trials(variation, start)
    shapes = []
    for tension_n in tensions_n:
        nearest = int(np.argmin(np.abs(state[at.TENSION] - tension_n)))
        if tension_n == 0:
            nearest = 0
        shapes.append(state[at.MODES : at.MODES + 3, nearest])
    return shapes


def draw_finger(path: Path) -> None:
    """Draw the free finger at the tensions of the paper's Fig. 1, and the trial of its Fig. 7."""
    figure, axes = plt.subplots(
        1, 3, figsize=(13, 4.2), width_ratios=(1, 1, 1.3), layout='constrained'
    )
    for ax, contact in zip(axes, PAPER_TENSIONS_N, strict=False):
        finger = build_scene('stiffness', 'none', contact).finger
        for tension_n, modes in zip(
            PAPER_TENSIONS_N[contact],
            find_free_shapes(contact, PAPER_TENSIONS_N[contact]),
            strict=True,
        ):
            x_mm, z_mm = 1e3 * compute_curve(finger.length_m, modes).T
            (line,) = ax.plot(x_mm, z_mm, lw=3, solid_capstyle='round')
            bend_deg = np.degrees(modes[0])
            ax.annotate(
                f'{tension_n} N\n{bend_deg:.0f}°',
                (x_mm[-1], z_mm[-1]),
                textcoords='offset points',
                xytext=(6, 4) if bend_deg < 88 else (-30, -16),
                color=line.get_color(),
                fontsize=9,
            )
        touch_rad = np.radians(finger.contact_bend_deg)
        touch_mm = 1e3 * finger.length_m * (1 - np.cos(touch_rad)) / touch_rad
        ax.axhline(touch_mm, color='0.6', lw=1, ls='--')
        ax.annotate('top of a plate', (-3, touch_mm), color='0.4', fontsize=8, va='bottom')
        ax.set(
            title=f'{contact}, free and at rest',
            xlabel='reach [mm]',
            ylabel='drop [mm]',
            xlim=(-6, 100),
            ylim=(75, -6),
            aspect='equal',
        )
    draw_hold(axes[2])
    figure.suptitle("SIMULATED: the finger at the tensions of the paper's Fig. 1 and 7")
    figure.savefig(path, dpi=130)


def draw_hold(ax: Any) -> None:
    """Draw a simulated stiffness trial on the rubber shell, and the line of the paper's Fig. 7."""
    scene = build_scene('stiffness', 'rubber_shell', 'flexion')
    pull_m = PULL_M['flexion']
    motion = simulate_motion(
        scene,
        Timeline([], [Move(0.5, pull_m, 0.01), Move(5.0, 0.0, 0.01)], 5.8),
        Variation.none(1),
    )
    time_s, tension_n = motion.sample_times_s, motion.truth['tension_n'][0]
    held = (time_s > 1.0) & (time_s < 4.9)
    window_s = time_s[held] - time_s[held][0]
    result = compute_regression(np.rint(1e9 * window_s).astype(np.int64), tension_n[held])
    slope, intercept, correlation = (float(value) for value in result)
    ax.plot(time_s, tension_n, color='C0', lw=1.5, label='simulated, rubber shell')
    ax.plot(
        time_s[held],
        PAPER_INTERCEPT_N + PAPER_SLOPE_N_S * window_s,
        color='C3',
        ls='--',
        label='the line that the paper gives',
    )
    ax.set(
        title='flexion stiffness trial',
        xlabel='time [s]',
        ylabel='tension [N]',
        ylim=(-0.5, 16),
    )
    ax.text(
        1.15,
        2.0,
        f'            slope      intercept   correlation\n'
        f'simulated  {slope:.2f} N/s  {intercept:.2f} N   {correlation:.3f}\n'
        f'paper      {PAPER_SLOPE_N_S:.2f} N/s  {PAPER_INTERCEPT_N:.2f} N   {PAPER_CORRELATION}',
        family='monospace',
        fontsize=7,
    )
    ax.legend(loc='upper right', fontsize=8)


def draw_glide(path: Path) -> None:
    """Draw the path of the fingertip over each of three plates, and the tension on the way."""
    figure, axes = plt.subplots(2, 3, figsize=(13, 5), sharex=True, layout='constrained')
    for column, label in zip(axes.T, ('R1', 'T2', 'C1'), strict=True):
        draw_passage(column, build_scene('texture', label, 'flexion'), label)
    axes[0, 0].set_ylabel('height [mm]')
    axes[1, 0].set_ylabel('tension,\nline removed [mN]')
    handles = axes[0, 0].get_legend_handles_labels()[0] + axes[1, 0].get_legend_handles_labels()[0]
    figure.legend(handles=handles, loc='outside lower center', ncols=3, fontsize=9)
    figure.suptitle('SIMULATED: 20 mm of glide over three plates at 15 mm/s')
    figure.savefig(path, dpi=130)


def draw_passage(column: Any, scene: Scene, label: str) -> None:
    """Draw one plate: above, the path of the fingertip over the profile; below, the tension."""
    assert scene.surface is not None
    timeline = Timeline([Move(0.9, 0.110, 0.015)], [Move(0.2, PULL_M['flexion'], 0.02)], 4.0)
    fast = dataclasses.replace(scene.rig.load_cell, rate_hz=1000.0)
    continuous = dataclasses.replace(scene, rig=dataclasses.replace(scene.rig, load_cell=fast))
    fine = simulate_motion(continuous, timeline, Variation.none(1))
    sampled = simulate_motion(scene, timeline, Variation.none(1))
    from_s, until_s = 1.8, 1.8 + 20 / 15

    def place_mm(time_s: FloatArray) -> FloatArray:
        return (time_s - from_s) * 15.0

    x_mm = np.linspace(0.0, 20.0, 2000)
    # The fingertip moves over the plate at nearly the speed of the guide, because the horizontal
    # distance between fingertip and guide is nearly constant.
    first_m = scene.lead_m + (from_s - 0.915) * 0.015
    height = scene.surface.sample(first_m + 1e-3 * x_mm)[0]
    column[0].plot(x_mm, 1e3 * height, color='0.3', label='as a 5 mm fingertip feels it')
    column[0].set(title=f'plate {label}', ylim=(-0.3, 0.05))
    trend = None
    for motion, style in (
        (fine, {'color': 'C0', 'lw': 1, 'label': 'tension'}),
        (
            sampled,
            {'color': 'C3', 'marker': '.', 'ls': '', 'label': 'sensor, 60 Hz, 35 Hz low pass'},
        ),
    ):
        chosen = (motion.sample_times_s >= from_s) & (motion.sample_times_s <= until_s)
        time_s = motion.sample_times_s[chosen]
        values = motion.truth['tension_n'] if motion is fine else motion.sensed_n
        if trend is None:
            trend = np.polyfit(time_s, values[0, chosen], 1)
        column[1].plot(
            place_mm(time_s), 1e3 * (values[0, chosen] - np.polyval(trend, time_s)), **style
        )
    column[1].set(xlabel='glide [mm]')


if __name__ == '__main__':
    main()
