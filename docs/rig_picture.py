# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Draw the plates and the rig, with the dimensions in the descriptions of the simulator."""

from __future__ import annotations

from pathlib import Path

from matplotlib import pyplot as plt
from matplotlib.patches import FancyArrowPatch, Rectangle
import numpy as np

from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.descriptions.description import Plate
from tactile_sim.physics.equations import compute_curve
from tactile_sim.physics.scene import compute_plate_profile

SHOWN_MM = 22.0
"""Length of the part of a plate that is drawn, from the end of the plate [mm]."""


def draw_plates(path: Path) -> None:
    """Draw the side view of every packaged plate, to scale, with its dimensions."""
    catalogue = default_catalogue()
    labels = catalogue.labels('texture')
    figure, axes = plt.subplots(
        (len(labels) + 1) // 2, 2, figsize=(10, 1.0 * len(labels) / 2 + 0.6), layout='constrained'
    )
    x_mm = np.linspace(0.0, SHOWN_MM, 4401)
    for ax, label in zip(axes.T.flat, labels, strict=True):
        plate = catalogue.plate(label)
        top_mm = 1e3 * compute_plate_profile(plate, 1e-3 * x_mm, 0.0)
        ax.fill_between(x_mm, -2.5, top_mm, color='0.75', lw=0)
        ax.plot(x_mm, top_mm, color='0.2', lw=1)
        ax.set(aspect='equal', xlim=(0, SHOWN_MM), ylim=(-2.5, 0.4), yticks=[])
        ax.set_title(f'{label}: {describe_plate(plate)}', loc='left', fontsize=9)
        ax.tick_params(labelsize=7)
        for side in ('top', 'left', 'right'):
            ax.spines[side].set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel('from the end of the plate [mm]', fontsize=8)
    figure.suptitle('Plates of the simulator, side view; every dimension is assumed', fontsize=10)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def describe_plate(plate: Plate) -> str:
    """Return groove shape, pitch, width and depth as text."""
    if plate.groove == 'none':
        return 'flat'
    return (
        f'{plate.groove}, pitch {plate.pitch_mm:g}, width {plate.width_mm:g}, '
        f'depth {plate.depth_mm:g} mm'
    )


def draw_rig(path: Path) -> None:
    """Draw the connections of finger, tendon, sensor, servo and guide; not to scale."""
    finger = default_catalogue().finger('flexion')
    bend_rad = np.radians(finger.contact_bend_deg)
    x_mm, z_mm = 1e3 * compute_curve(finger.length_m, np.array([bend_rad, 0.0, 0.0])).T
    figure, ax = plt.subplots(figsize=(10, 3.5), layout='constrained')
    grey, steel = '0.85', 'tab:blue'

    def box(x: float, y: float, width: float, height: float, text: str) -> None:
        ax.add_patch(Rectangle((x, y), width, height, fc=grey, ec='0.3'))
        ax.text(x + width / 2, y + height / 2, text, ha='center', va='center', fontsize=8)

    box(-180, -12, 52, 24, 'servo\nDynamixel X,\npulley')
    box(-105, -10, 44, 20, 'force sensor\non the tendon')
    box(-105, -19, 44, 9, 'low-friction guide')
    box(-30, -10, 30, 20, 'finger base')
    for start, end in ((-128, -105), (-61, -30)):
        ax.plot((start, end), (0, 0), color=steel, lw=2)
    ax.text(-20, -20, 'steel tendon, 0.5 mm', color=steel, fontsize=8, ha='center')
    ax.plot(x_mm, -z_mm, color='tab:orange', lw=9, solid_capstyle='round')
    ax.text(
        30,
        6,
        f'finger, {1e3 * finger.length_m:g} mm, bent {finger.contact_bend_deg:g}°',
        fontsize=8,
    )
    tip_mm = float(-z_mm[-1])
    radius_mm = 1e3 * finger.tip_radius_m
    ax.add_patch(plt.Circle((x_mm[-1], tip_mm), radius_mm, fc='tab:red', ec='none'))
    ax.text(x_mm[-1] + 8, tip_mm + 4, 'polyurethane cap', fontsize=8)
    plate_mm = tip_mm - radius_mm
    box(20, plate_mm - 10, 100, 10, 'plate (texture) or object (stiffness)')
    ax.add_patch(Rectangle((-185, 18), 190, 5, fc='0.6', ec='0.3'))
    ax.text(-90, 26, 'palpation unit', ha='center', fontsize=8)
    arrow = FancyArrowPatch(
        (-60, 36), (20, 36), arrowstyle='<|-|>', mutation_scale=14, color='0.2'
    )
    ax.add_patch(arrow)
    ax.text(-20, 39, 'linear guide (Grbl) moves the unit along the plate', ha='center', fontsize=8)
    ax.set(xlim=(-190, 160), ylim=(plate_mm - 16, 46), aspect='equal')
    ax.axis('off')
    ax.set_title('Schematic, not to scale; shape of the finger from the simulator', fontsize=10)
    figure.savefig(path, dpi=110)
    plt.close(figure)
