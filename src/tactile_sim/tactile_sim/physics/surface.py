# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Surface traced by a fingertip of finite radius over a plate or a cylinder."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tactile_sim.descriptions.description import Plate

FloatArray = NDArray[np.float64]

SPACING_M = 1e-5


@dataclass(frozen=True)
class Surface:
    """Height of a surface on an even grid, with slope and curvature.

    Attributes
    ----------
    origin_m
        Coordinate of the first grid point [m].
    spacing_m
        Distance of the grid points [m].
    table : ndarray of float, shape (cells, 4)
        Height [m] and slope [1] at the cell's left end, and their rise across the cell.
    """

    origin_m: float
    spacing_m: float
    table: FloatArray

    def sample(self, x_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Height [m], slope [1] and curvature [1/m] at ``x_m``; level beyond the grid."""
        cell = (x_m - self.origin_m) / self.spacing_m
        index = np.minimum(np.maximum(np.floor(cell), 0), len(self.table) - 1)
        part = np.minimum(np.maximum(cell - index, 0.0), 1.0)
        height, rise, slope, bend = self.table[index.astype(np.intp)].T
        return height + part * rise, slope + part * bend, bend / self.spacing_m


def build_surface(height_m: FloatArray, origin_m: float, spacing_m: float) -> Surface:
    """Make a surface from heights on an even grid; shape (points,) [m]."""
    # The slope is continuous (central differences, then linear), so that the
    # equilibrium stays findable where two flanks meet at a corner.
    slope = np.gradient(height_m, spacing_m)
    slope[0] = slope[-1] = 0.0
    table = np.column_stack([height_m[:-1], np.diff(height_m), slope[:-1], np.diff(slope)])
    return Surface(origin_m, spacing_m, np.ascontiguousarray(table))


def compute_plate_profile(plate: Plate, x_m: FloatArray, tray_depth_m: float) -> FloatArray:
    """Height of the bare plate along its length [m]; 0 is its top, x = 0 its edge.

    Parameters
    ----------
    x_m : ndarray of float, shape (points,)
        Coordinate along the plate [m].
    tray_depth_m
        How far the tray beside the plate lies below its top [m].
    """
    height = np.where((x_m >= 0) & (x_m <= plate.length_m), 0.0, -tray_depth_m)
    if plate.groove == 'none':
        return height
    along = x_m - plate.end_mm * 1e-3
    if plate.groove == 'profile':
        points_m = 1e-3 * np.array(plate.points_mm)
        drawn = np.interp(along, points_m[:, 0], points_m[:, 1])
        return np.where((along >= 0) & (along <= plate.grooved_mm * 1e-3), drawn, height)
    width, depth = plate.width_mm * 1e-3, plate.depth_mm * 1e-3
    # Each pitch is half a land, a groove, half a land; no groove is cut at the zone's end.
    pitch = plate.pitch_mm * 1e-3
    count = int(plate.grooved_mm * 1e-3 / pitch + 1e-9)
    off_centre = np.abs(np.mod(along, pitch) - pitch / 2)
    in_groove = (off_centre < width / 2) & (along >= 0) & (along < count * pitch)
    if plate.groove == 'rectangular':
        bottom = np.full_like(x_m, -depth)
    elif plate.groove == 'triangular':
        bottom = -depth * (1 - off_centre / (width / 2))
    else:
        radius = (width**2 / 4 + depth**2) / (2 * depth)
        inside = np.maximum(radius**2 - off_centre**2, 0.0)
        bottom = radius - depth - np.sqrt(inside)
    return np.where(in_groove, bottom, height)


def dilate_by_circle(height_m: FloatArray, spacing_m: float, radius_m: float) -> FloatArray:
    """Height of the lowest point of a circle that rests on a profile, for each position.

    The greyscale dilation of the profile by the circle: max over u of
    ``h(x + u) + sqrt(R^2 - u^2) - R``; the end values continue beyond the ends.

    Parameters
    ----------
    height_m : ndarray of float, shape (points,)
        Profile on an even grid [m].

    Returns
    -------
    ndarray of float, shape (points,)
    """
    reach = int(radius_m / spacing_m)
    padded = np.pad(height_m, reach, mode='edge')
    dilated = np.full(len(height_m), -np.inf)
    for shift in range(-reach, reach + 1):
        drop = radius_m - np.sqrt(radius_m**2 - (shift * spacing_m) ** 2)
        part = padded[reach + shift : reach + shift + len(height_m)]
        np.maximum(dilated, part - drop, out=dilated)
    return dilated


@lru_cache
def build_plate_surface(plate: Plate, tip_radius_m: float, tray_depth_m: float) -> Surface:
    """Return the surface that a fingertip of this radius traces over a plate in its tray."""
    margin = 0.02
    points = round((plate.length_m + 2 * margin) / SPACING_M) + 1
    x_m = -margin + SPACING_M * np.arange(points, dtype=np.float64)
    bare = compute_plate_profile(plate, x_m, tray_depth_m)
    return build_surface(dilate_by_circle(bare, SPACING_M, tip_radius_m), -margin, SPACING_M)


@lru_cache
def build_crown_surface(radius_m: float, tip_radius_m: float) -> Surface:
    """Return the surface that a fingertip traces over a lying cylinder; the crown is at 0."""
    both_m = radius_m + tip_radius_m
    points = round(both_m / SPACING_M)  # to half the sum on either side: 30 deg steep
    x_m = SPACING_M * (np.arange(points, dtype=np.float64) - points // 2)
    return build_surface(np.sqrt(both_m**2 - x_m**2) - both_m, float(x_m[0]), SPACING_M)
