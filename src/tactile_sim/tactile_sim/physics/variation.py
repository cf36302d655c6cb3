# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reproducible random variation of trials, mountings and sessions."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields
import hashlib

import numpy as np
from numpy.typing import NDArray

from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.descriptions.description import VariationSpread
from tactile_sim.errors import DescriptionError

FloatArray = NDArray[np.float64]

_WIDEST = 3.0


@dataclass(frozen=True)
class Variation:
    """Deviations of each trial from the description; arrays of shape (trials,).

    ``contact_height_m`` and ``placement_m`` are the shifts of plate or object in height and along
    the guide [m]. ``friction``, ``object_stiffness``, ``finger_stiffness`` and ``glide_speed``
    are factors around 1. ``tendon_zero_m`` is the tendon displacement at which the slack ends
    [m]. ``sensor_bias_n`` is the reading of the sensor without load [N]. ``phase`` is the lag of
    the sensor's samples behind the motion, as a fraction of the sampling period in [0, 1).
    """

    contact_height_m: FloatArray
    placement_m: FloatArray
    friction: FloatArray
    object_stiffness: FloatArray
    finger_stiffness: FloatArray
    glide_speed: FloatArray
    tendon_zero_m: FloatArray
    sensor_bias_n: FloatArray
    phase: FloatArray

    @classmethod
    def none(cls, count: int = 1) -> Variation:
        """Return the variation of ``count`` trials that do not deviate from the description."""
        zero, one = np.zeros(count), np.ones(count)
        return cls(zero, zero, one, one, one, one, zero, zero, zero)

    def select(self, trials: slice) -> Variation:
        """Return the variation of the selected trials only."""
        return Variation(**{item.name: getattr(self, item.name)[trials] for item in fields(self)})


def draw_variation(
    catalogue: Catalogue,
    contact: str,
    protocol: str,
    label: str,
    seed: int,
    session: int,
    count: int,
    first: int = 0,
    trials_per_mounting: int = 1,
) -> tuple[Variation, list[np.random.Generator]]:
    """Draw the deviations of trials ``first`` to ``first + count - 1`` of a session.

    Trial i depends only on (seed, session, protocol, contact, label, i), not on the count. It
    belongs to mounting i // trials_per_mounting of its label. The deviations of a mounting
    depend only on (seed, session, protocol, contact, label, mounting). The deviations of the
    session depend only on (seed, session, contact), so that all plates and objects share them.
    Every deviation is normally distributed, limited to three standard deviations. Each trial has
    its own random generator for the noise of the sensor.

    Raises `DescriptionError` for an unknown contact, or less than one trial per mounting.
    """
    if trials_per_mounting < 1:
        raise DescriptionError(
            f'trials_per_mounting is {trials_per_mounting}; it must be at least 1'
        )
    finger, rig = catalogue.finger(contact), catalogue.rig()
    numbers = range(first, first + count)
    generators = [make_generator(seed, session, protocol, contact, label, i) for i in numbers]
    trial = _draw_deviations(rig.variation.trial, generators)
    phase = np.array([generator.random() for generator in generators])
    mountings = np.arange(first, first + count) // trials_per_mounting
    different, belongs = np.unique(mountings, return_inverse=True)
    names = (seed, session, 'mounting', protocol, contact, label)
    mounted = [make_generator(*names, number) for number in different]
    mounting = _draw_deviations(rig.variation.mounting, mounted)[:, belongs]
    shared = _draw_deviations(rig.variation.session, [make_generator(seed, session, contact)])
    height, place, *_, zero, warmer_k = (shared + mounting) + trial
    factors = ((1 + shared) * (1 + mounting)) * (1 + trial)
    _, _, friction, body, stiffness, speed, _, _ = factors
    variation = Variation(
        contact_height_m=height,
        placement_m=place,
        friction=friction,
        object_stiffness=body,
        finger_stiffness=stiffness * (1 + finger.stiffness_per_k * warmer_k),
        glide_speed=speed,
        tendon_zero_m=zero,
        sensor_bias_n=rig.load_cell.bias_n_per_k * warmer_k,
        phase=phase,
    )
    return variation, generators


def make_generator(*names: int | str) -> np.random.Generator:
    """Return a random generator that is seeded with ``names`` only."""
    # The seed is a hash of all names. NumPy's own seeding with a list of numbers would pad short
    # lists with zeros and split large numbers, so that different lists could get the same seed.
    text = repr([name if isinstance(name, str) else int(name) for name in names])
    return np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest(), 'big'))


def _draw_deviations(spread: VariationSpread, generators: list[np.random.Generator]) -> FloatArray:
    """Return one row per field of ``spread`` and one column per generator, shape (8, n)."""
    drawn = np.array([generator.standard_normal(8) for generator in generators]).reshape(-1, 8).T
    sizes = np.array(astuple(spread))[:, np.newaxis]
    return np.asarray(sizes * np.clip(drawn, -_WIDEST, _WIDEST))
