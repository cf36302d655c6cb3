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

    Mounting height relative to the described one, and shift of plate or object along the guide
    [m]; factors around 1; tendon displacement at which slack ends [m]; reading without load [N];
    lag of the sensor behind the motion, as a fraction of the sampling period in [0, 1).
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
        """Return trials exactly as described."""
        zero, one = np.zeros(count), np.ones(count)
        return cls(zero, zero, one, one, one, one, zero, zero, zero)

    def select(self, trials: slice) -> Variation:
        """Return some of the trials."""
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
    """Return a random generator that depends only on these names."""
    # Hashed, so that different lists of names never share a stream: NumPy's own seeding pads short
    # lists with zeros and splits large numbers into words.
    text = repr([name if isinstance(name, str) else int(name) for name in names])
    return np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest(), 'big'))


def _draw_deviations(spread: VariationSpread, generators: list[np.random.Generator]) -> FloatArray:
    """Return deviations in the order of the fields of ``spread``, shape (8, generators)."""
    drawn = np.array([generator.standard_normal(8) for generator in generators]).reshape(-1, 8).T
    sizes = np.array(astuple(spread))[:, np.newaxis]
    return np.asarray(sizes * np.clip(drawn, -_WIDEST, _WIDEST))
