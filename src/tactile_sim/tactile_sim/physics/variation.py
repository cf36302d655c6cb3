# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""How each trial comes out a little different, and each session: draws that repeat."""

from __future__ import annotations

from dataclasses import dataclass, fields
import hashlib

import numpy as np
from numpy.typing import NDArray

from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.descriptions.description import VariationSpread

FloatArray = NDArray[np.float64]

_WIDEST = 3.0


@dataclass(frozen=True)
class Variation:
    """How each trial differs from the description; arrays of shape (trials,).

    Attributes
    ----------
    contact_height_m
        Mounting height of plate or object above the described one [m].
    placement_m
        Plate or object along the guide [m].
    friction, object_stiffness, finger_stiffness, glide_speed
        Factors around 1.
    tendon_zero_m
        Tendon displacement at which the tendon is just slack [m].
    sensor_bias_n
        What the sensor reads without load [N].
    phase
        Part of a sampling period by which the sensor lags the motion, in [0, 1).
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
        """Trials exactly as described."""
        zero, one = np.zeros(count), np.ones(count)
        return cls(zero, zero, one, one, one, one, zero, zero, zero)

    def select(self, trials: slice) -> Variation:
        """Some of the trials."""
        return Variation(**{item.name: getattr(self, item.name)[trials] for item in fields(self)})


@dataclass(frozen=True)
class _Deviations:
    """What one level, trial or session, adds to the described values."""

    contact_height_m: FloatArray
    placement_m: FloatArray
    friction: FloatArray
    object_stiffness: FloatArray
    finger_stiffness: FloatArray
    glide_speed: FloatArray
    tendon_zero_m: FloatArray
    temperature_k: FloatArray


def draw_variation(
    catalogue: Catalogue,
    contact: str,
    protocol: str,
    label: str,
    seed: int,
    session: int,
    count: int,
    first: int = 0,
) -> tuple[Variation, list[np.random.Generator]]:
    """Draw the deviations of trials ``first`` to ``first + count - 1`` of a session.

    Trial i depends on (seed, session, protocol, contact, label, i) alone, whatever the count.
    The session's own deviations depend on (seed, session, contact) alone: all plates and
    objects of a session share its mounting. Every deviation is normal, cut at three standard
    deviations.

    Returns
    -------
    variation : Variation
        Shape (count,).
    generators : list of numpy.random.Generator
        One a trial, for its sensor's noise.

    Raises
    ------
    DescriptionError
        No such contact.
    """
    finger, rig = catalogue.finger(contact), catalogue.rig()
    numbers = range(first, first + count)
    generators = [make_generator(seed, session, protocol, contact, label, i) for i in numbers]
    trial = _draw_deviations(rig.variation.trial, generators)
    phase = np.array([generator.random() for generator in generators])
    shared = _draw_deviations(rig.variation.session, [make_generator(seed, session, contact)])
    warmer_k = shared.temperature_k + trial.temperature_k
    variation = Variation(
        contact_height_m=shared.contact_height_m + trial.contact_height_m,
        placement_m=shared.placement_m + trial.placement_m,
        friction=(1 + shared.friction) * (1 + trial.friction),
        object_stiffness=(1 + shared.object_stiffness) * (1 + trial.object_stiffness),
        finger_stiffness=(1 + shared.finger_stiffness)
        * (1 + trial.finger_stiffness)
        * (1 + finger.stiffness_per_k * warmer_k),
        glide_speed=(1 + shared.glide_speed) * (1 + trial.glide_speed),
        tendon_zero_m=shared.tendon_zero_m + trial.tendon_zero_m,
        sensor_bias_n=rig.load_cell.bias_n_per_k * warmer_k,
        phase=phase,
    )
    return variation, generators


def make_generator(*names: int | str) -> np.random.Generator:
    """Make the random stream that belongs to these names alone."""
    # Hashed, so that no two lists of names meet in one stream: NumPy's own seeding pads short
    # lists with zeros and cuts large numbers into words.
    text = repr([name if isinstance(name, str) else int(name) for name in names])
    return np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest(), 'big'))


def _draw_deviations(
    spread: VariationSpread, generators: list[np.random.Generator]
) -> _Deviations:
    drawn = np.array([generator.standard_normal(8) for generator in generators]).reshape(-1, 8).T
    height, place, friction, body, finger, speed, zero, warmer = np.clip(drawn, -_WIDEST, _WIDEST)
    return _Deviations(
        contact_height_m=spread.contact_height_m * height,
        placement_m=spread.placement_m * place,
        friction=spread.friction * friction,
        object_stiffness=spread.object_stiffness * body,
        finger_stiffness=spread.finger_stiffness * finger,
        glide_speed=spread.glide_speed * speed,
        tendon_zero_m=spread.tendon_zero_m * zero,
        temperature_k=spread.temperature_k * warmer,
    )
