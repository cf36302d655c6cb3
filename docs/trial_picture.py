# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Draw one simulated trial: shapes of the finger to scale, tension, and spectrum.

./tactile run python docs/trial_picture.py corduroy.png --description mine
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
import math
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
import numpy as np
from numpy.typing import NDArray

from tactile_analysis.plots import draw_spectrum, shade_phases
from tactile_bringup.trial_protocols import TrialConfig
from tactile_features.config import FeatureConfig
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_lab.simulation.simulated_trials import plan_trial, SimulationPlan, TrialSchedule
from tactile_ros.errors import TactileError
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.descriptions.description import Finger
from tactile_sim.errors import TactileSimError
from tactile_sim.physics.equations import compute_curve
from tactile_sim.physics.scene import build_scene, compute_plate_profile
from tactile_sim.physics.trials import simulate_motion
from tactile_sim.physics.variation import Variation

FloatArray = NDArray[np.float64]

MM = 1e3
SHAPE_STYLES = {
    'at rest': ('0.65', '-'),
    'start': ('#1f4e79', '-'),
    'middle': ('#2e8b57', '-'),
    'end': ('#d2691e', '--'),
}
"""Colour and line style of the finger at each moment. The last line is dashed, because the shapes
of the finger at the start and at the end of a hold coincide."""

BODY_DEPTH_M = 0.012
"""Drawn depth of plates and objects [m]; the model only contains their surface."""


@dataclass(frozen=True)
class Shape:
    """The finger at one moment.

    Attributes
    ----------
    moment : str
        ``at rest``, or ``start``, ``middle`` or ``end`` of the measured phase.
    at_s : float
        Time since the trial's first sample [s].
    curve_m : ndarray of shape (points, 2)
        Centre line in the guide's frame: position along the guide, drop below the base [m].
    """

    moment: str
    at_s: float
    curve_m: FloatArray


@dataclass(frozen=True)
class TrialPicture:
    """Data for the drawing of a trial.

    ``times_s``, of shape (samples,), is relative to the trial's first sample [s]. ``truth``
    contains the state of the simulated finger at these times, without errors of the sensor.
    """

    plan: SimulationPlan
    label: str
    catalogue: Catalogue
    planned: TrialSchedule
    times_s: FloatArray
    truth: Mapping[str, FloatArray]
    shapes: Sequence[Shape]


def main() -> None:
    """Draw the trial selected by the arguments."""
    parser = argparse.ArgumentParser(
        description='Simulate one trial without variation or noise, and draw it.'
    )
    parser.add_argument('picture', type=Path, help='PNG file to write')
    parser.add_argument('--protocol', choices=('texture', 'stiffness'), default='texture')
    parser.add_argument('--contact', choices=('flexion', 'abduction'), default='flexion')
    parser.add_argument(
        '--description',
        type=Path,
        help='folder with your own finger, rig, plates or objects: YAML files that replace values '
        'of the package',
    )
    arguments = parser.parse_args()
    plan = SimulationPlan(arguments.protocol, arguments.contact, 1, 1)
    try:
        plot_simulated_trial(
            arguments.picture, plan, TrialConfig(), Catalogue(arguments.description)
        )
    except (TactileError, TactileSimError) as error:
        parser.error(str(error))


def simulate_picture(
    plan: SimulationPlan, config: TrialConfig, catalogue: Catalogue
) -> TrialPicture:
    """Simulate the trial to draw, and choose the moments at which the finger is drawn."""
    label = _choose_label(plan.protocol, catalogue)
    planned = plan_trial(config, plan.request, catalogue)
    scene = build_scene(plan.protocol, label, plan.contact, catalogue)
    motion = simulate_motion(scene, planned.timeline, Variation.none(1), keep_modes=True)
    if np.isfinite(motion.failed_at_s[0]):
        raise TactileError(
            f'the simulation of the drawn trial on {label} found no equilibrium at '
            f'{motion.failed_at_s[0]:.3f} s; check the description'
        )
    times_s, truth = motion.sample_times_s, motion.truth
    finger = catalogue.finger(plan.contact)
    shapes = []
    for moment, at_s, guide_m in _moments(planned):
        sample = min(int(np.searchsorted(times_s, at_s)), len(times_s) - 1)
        curve_m = compute_curve(finger.length_m, truth['modes_rad'][0, sample])
        shapes.append(Shape(moment, at_s, curve_m + np.array([guide_m, 0.0])))
    alone = {name: values[0] for name, values in truth.items()}
    return TrialPicture(plan, label, catalogue, planned, times_s, alone, shapes)


def _choose_label(protocol: str, catalogue: Catalogue) -> str:
    """Return the label of the first plate with grooves, or of the softest object."""
    labels = catalogue.labels(protocol)
    if protocol == 'texture':
        return next((name for name in labels if catalogue.plate(name).groove != 'none'), labels[0])
    # A stiffness of 0 means that there is no object.
    return min(labels, key=lambda name: catalogue.body(name).stiffness_n_m or math.inf)


def find_measured_phase(planned: TrialSchedule) -> str:
    return next(name for name, _ in planned.phases if name in ('glide', 'hold'))


def _moments(planned: TrialSchedule) -> list[tuple[str, float, float]]:
    """Return the moment, time [s] and guide position [m] of each drawn shape."""
    starts, measured = dict(planned.phases), find_measured_phase(planned)
    begin_s, end_s = starts[measured], starts['release']
    begin_m = planned.timeline.guide_start_m
    end_m = planned.timeline.guide_moves[-1].target_m
    moments = [('at rest', 0.0, begin_m), ('start', begin_s, begin_m)]
    if measured == 'glide':
        # Acceleration and braking are symmetric, so half of the way takes half of the time.
        moments.append(('middle', (begin_s + end_s) / 2, (begin_m + end_m) / 2))
    return [*moments, ('end', end_s, end_m)]


def compute_touching_tip(finger: Finger) -> tuple[float, float]:
    """Return reach and drop [m] of the tip at first contact, if the finger is a circular arc."""
    modes_rad = np.array([np.radians(finger.contact_bend_deg), 0.0, 0.0])
    reach_m, drop_m = compute_curve(finger.length_m, modes_rad)[-1]
    return float(reach_m), float(drop_m)


def surface_drop_m(finger: Finger) -> float:
    """Return how far below the base the top of plates and objects is drawn [m].

    In the model, the drop of the tip is the drop of its lowest point. In the figure, the centre
    line ends in the middle of the tip. The top is therefore drawn lower by the tip's radius.
    """
    return compute_touching_tip(finger)[1] + finger.tip_radius_m


def plot_simulated_trial(
    path: Path, plan: SimulationPlan, config: TrialConfig, catalogue: Catalogue
) -> None:
    """Simulate a trial with nominal values, without variation or noise, and draw it.

    ``path`` is the PNG file. ``plan`` contains protocol and contact.

    Raises `TactileError` when the file cannot be written, or the simulator finds no solution.
    """
    figure = draw_picture(simulate_picture(plan, config, catalogue))
    try:
        figure.savefig(path, dpi=130, format='png')
    except OSError as error:
        raise TactileError(f'cannot write {path}: {error.strerror}; use another file') from error


def draw_picture(picture: TrialPicture) -> Figure:
    """Draw the finger's shapes, the tension, and the spectrum or the contact force."""
    extra: dict[str, Callable[[Axes, TrialPicture], None]] = {
        'texture': _draw_spectrum,
        'stiffness': _draw_force,
    }
    figure = Figure(figsize=(9, 9.5), layout='constrained')
    shapes, tension, last = figure.subplots(3, 1, height_ratios=(1.5, 1.0, 0.8))
    _draw_shapes(shapes, picture)
    _draw_tension(tension, picture)
    extra[picture.plan.protocol](last, picture)
    figure.suptitle(
        f'SIMULATED {picture.plan.protocol} trial: {picture.plan.contact} on {picture.label}\n'
        'exactly as described, without variation or noise; no number is a measurement'
    )
    return figure


def _draw_shapes(axes: Axes, picture: TrialPicture) -> None:
    finger = picture.catalogue.finger(picture.plan.contact)
    _draw_touched(axes, picture)
    measured = find_measured_phase(picture.planned)
    for shape in picture.shapes:
        colour, line = SHAPE_STYLES[shape.moment]
        of_phase = '' if shape.moment == 'at rest' else f' of the {measured}'
        outline_m = _outline(shape.curve_m, finger.tip_radius_m)
        axes.add_patch(Polygon(MM * outline_m, facecolor=colour, alpha=0.12, lw=0, zorder=2))
        axes.plot(
            *(MM * shape.curve_m.T),
            color=colour,
            ls=line,
            lw=1.8,
            zorder=3,
            label=f'{shape.moment}{of_phase}, {shape.at_s:.2f} s',
        )
        base_mm, tip_mm = MM * shape.curve_m[0], MM * shape.curve_m[-1]
        radius_mm = MM * finger.tip_radius_m
        circle = Circle(tuple(tip_mm), radius_mm, fill=False, ec=colour, ls=line, lw=1.5, zorder=3)
        axes.add_patch(circle)
        axes.plot(*base_mm, marker='s', ms=7, color=colour, zorder=4)
    axes.set(
        xlabel='along the guide [mm], to scale; square: base, circle: fingertip',
        ylabel='drop below the base [mm]',
    )
    axes.set_aspect('equal', adjustable='datalim')
    axes.invert_yaxis()
    axes.legend(loc='lower center', bbox_to_anchor=(0.5, 1.0), ncols=4, frameon=False, fontsize=9)


def _outline(curve_m: FloatArray, half_width_m: float) -> FloatArray:
    """Return the outline to draw around the centre line of the finger.

    The finger in the model has no thickness.
    """
    tangent = np.gradient(curve_m, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across_m = half_width_m * np.column_stack([-tangent[:, 1], tangent[:, 0]])
    return np.concatenate([curve_m + across_m, (curve_m - across_m)[::-1]])


def _draw_touched(axes: Axes, picture: TrialPicture) -> None:
    """Draw the plate or object at its position under the finger."""
    catalogue, protocol = picture.catalogue, picture.plan.protocol
    finger, place = catalogue.finger(picture.plan.contact), catalogue.rig().placement
    reach_m, top_m = compute_touching_tip(finger)[0], surface_drop_m(finger)
    middle_m, half_m = place.object_guide_m + reach_m, place.object_half_width_m
    what = f'object {picture.label}'
    outline_m = _block_outline(middle_m, half_m, top_m)
    if protocol == 'texture':
        plate, what = catalogue.plate(picture.label), f'plate {picture.label}'
        along_m = np.linspace(0.0, plate.length_m, 4000, dtype=np.float64)
        edge_m = place.texture_guide_m + reach_m - place.texture_lead_m
        middle_m = edge_m + plate.length_m / 2
        profile_m = compute_plate_profile(plate, along_m, place.tray_depth_m)
        outline_m = np.column_stack([edge_m + along_m, top_m - profile_m])
        ends = [[outline_m[-1, 0], top_m + BODY_DEPTH_M], [edge_m, top_m + BODY_DEPTH_M]]
        outline_m = np.concatenate([outline_m, ends])
    elif catalogue.body(picture.label).stiffness_n_m == 0:
        what = 'no object'
    if what != 'no object':
        axes.add_patch(Polygon(MM * outline_m, fc='0.85', ec='0.4', lw=1, zorder=1))
    deepest_m = outline_m[:, 1].max()
    axes.text(MM * middle_m, MM * deepest_m + 1.0, what, ha='center', va='top', fontsize=9)
    axes.update_datalim(MM * np.array([[middle_m, deepest_m + 6e-3]]))


def _block_outline(middle_m: float, half_m: float, top_m: float) -> FloatArray:
    left, right, low = middle_m - half_m, middle_m + half_m, top_m + BODY_DEPTH_M
    return np.array([[left, top_m], [right, top_m], [right, low], [left, low]])


def _draw_tension(axes: Axes, picture: TrialPicture) -> None:
    _shade_phases(axes, picture)
    axes.plot(picture.times_s, picture.truth['tension_n'], color='#1f4e79', lw=1)
    for shape in picture.shapes:
        value = np.interp(shape.at_s, picture.times_s, picture.truth['tension_n'])
        colour = SHAPE_STYLES[shape.moment][0]
        axes.plot(shape.at_s, value, 'o', color=colour, ms=6, mec='white', zorder=3)
    axes.set(xlabel='time [s]', ylabel='tendon tension [N]')
    if picture.plan.protocol == 'texture':
        times_s, window_n = _texture_window(picture)
        ripple = axes.inset_axes((0.28, 0.12, 0.5, 0.38))
        ripple.plot(times_s, MM * (window_n - np.mean(window_n)), color='#1f4e79', lw=1)
        ripple.set_title('the window of the features, without its mean [mN]', fontsize=9)
        ripple.tick_params(labelsize=8)
        ripple.margins(x=0)


def _texture_window(picture: TrialPicture) -> tuple[FloatArray, FloatArray]:
    """Return times [s] and tension [N] of the window for texture features."""
    config = FeatureConfig()
    starts = dict(picture.planned.phases)
    first = int(np.searchsorted(picture.times_s, starts['glide'] + config.texture_crop_start_s))
    window = slice(first, first + config.texture_samples)
    return picture.times_s[window], picture.truth['tension_n'][window]


def _shade_phases(axes: Axes, picture: TrialPicture) -> None:
    phases = pairwise(picture.planned.phases)
    shade_phases(axes, [(name, start_s, end_s) for (name, start_s), (_, end_s) in phases])
    axes.set_xlim(0.0, picture.times_s[-1])
    axes.margins(y=0.18)


def _draw_spectrum(axes: Axes, picture: TrialPicture) -> None:
    """Draw the amplitude spectrum of the window for texture features."""
    config = FeatureConfig()
    amplitude_n = compute_spectrum(
        _texture_window(picture)[1], config.spectrum_detrend, config.spectrum_window
    )
    frequency_hz = np.arange(len(amplitude_n)) * config.rate_hz / config.texture_samples
    # If the signal is constant, all amplitudes are 0, which a logarithmic axis cannot show.
    draw_spectrum(axes, frequency_hz, np.maximum(MM * amplitude_n, 1e-3))
    plate = picture.catalogue.plate(picture.label)
    if plate.groove not in ('none', 'profile'):
        speed_m_s = picture.planned.timeline.guide_moves[-1].speed_m_s
        groove_hz = speed_m_s * MM / plate.pitch_mm
        axes.axvline(
            groove_hz,
            color='#c00000',
            lw=0.9,
            ls='--',
            label=f'grooves every {plate.pitch_mm:g} mm at {speed_m_s * MM:g} mm/s: '
            f'{groove_hz:.2f} Hz',
        )
        axes.legend(frameon=False)
    axes.set(xlabel='frequency [Hz]', ylabel='amplitude [mN]')
    axes.set_xlim(0.0, frequency_hz[-1])
    axes.set_title(
        f'amplitude spectrum of this window of {config.texture_samples} samples', fontsize=10
    )


def _draw_force(axes: Axes, picture: TrialPicture) -> None:
    """Draw the contact force, which no sensor of the rig measures."""
    _shade_phases(axes, picture)
    axes.plot(picture.times_s, picture.truth['contact_force_n'], color='#2e8b57', lw=1)
    axes.set(xlabel='time [s]', ylabel='true contact force [N]')


if __name__ == '__main__':
    main()
