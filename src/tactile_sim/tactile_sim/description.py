# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rig, its fingers, plates and objects, as described in ``config/*.yaml``."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import yaml

from tactile_sim.errors import DescriptionError

PROTOCOLS = ('texture', 'stiffness')
CONTACTS = ('flexion', 'abduction')

_CONFIG = Path(__file__).resolve().parent / 'config'
_T = TypeVar('_T')


def _positive() -> Any:
    return field(metadata={'above': 0.0})


def _not_negative() -> Any:
    return field(metadata={'from': 0.0})


def _any_number() -> Any:
    return field(metadata={})


@dataclass(frozen=True)
class Finger:
    """A tendon-driven finger of constant curvature, bending in one plane."""

    length_m: float = _positive()
    moment_arm_m: float = _positive()
    bending_stiffness_nm_rad: float = _positive()
    creep_stiffness_nm_rad: float = _not_negative()
    creep_time_s: float = _positive()
    damping_nm_s_rad: float = _positive()
    mass_kg: float = _not_negative()
    tip_mass_kg: float = _not_negative()
    tip_radius_m: float = _positive()
    tip_stiffness_n_m: float = _positive()
    contact_bend_deg: float = _positive()
    tendon_stiffness_n_m: float = _positive()
    tendon_friction: float = _not_negative()
    bend_stop_deg: float = _positive()
    stop_stiffness_nm_rad: float = _positive()

    def __post_init__(self) -> None:
        if not self.contact_bend_deg < self.bend_stop_deg < 150.0:
            raise DescriptionError(
                'contact_bend_deg must be below bend_stop_deg, and that below 150 deg'
            )


@dataclass(frozen=True)
class Plate:
    """A rigid texture plate: flat end, grooved zone, flat end; dimensions in millimetres."""

    groove: str
    pitch_mm: float = _positive()
    width_mm: float = _not_negative()
    depth_mm: float = _not_negative()
    end_mm: float = _positive()
    grooved_mm: float = _positive()
    friction: float = _not_negative()

    def __post_init__(self) -> None:
        shapes = ('none', 'rectangular', 'triangular', 'circular')
        if self.groove not in shapes:
            raise DescriptionError(f'groove is {self.groove!r}; it must be one of {shapes}')
        if self.groove != 'none' and not 0 < self.width_mm <= self.pitch_mm:
            raise DescriptionError('width_mm must be above 0 and at most pitch_mm')
        if self.groove == 'circular' and self.depth_mm > self.width_mm / 2:
            raise DescriptionError('depth_mm of a circular groove is at most half its width_mm')

    @property
    def length_m(self) -> float:
        """Length of the whole plate [m]."""
        return (2 * self.end_mm + self.grooved_mm) * 1e-3


@dataclass(frozen=True)
class Body:
    """An object to press on: a standard linear solid; stiffness 0 means that nothing is there."""

    stiffness_n_m: float = _not_negative()
    branch_stiffness_n_m: float = _not_negative()
    relaxation_time_s: float = _positive()
    friction: float = _not_negative()

    def __post_init__(self) -> None:
        if self.stiffness_n_m == 0 and self.branch_stiffness_n_m > 0:
            raise DescriptionError('a body without stiffness_n_m cannot have a branch')


@dataclass(frozen=True)
class Guide:
    """The linear guide and its Grbl controller."""

    travel_m: float = _positive()
    max_speed_m_s: float = _positive()
    acceleration_m_s2: float = _positive()
    step_m: float = _positive()
    pull_off_m: float = _positive()
    power_up_m: float = _not_negative()

    def __post_init__(self) -> None:
        if not self.power_up_m <= self.travel_m:
            raise DescriptionError('power_up_m must be at most travel_m')


@dataclass(frozen=True)
class TendonDrive:
    """The Dynamixel and its pulley."""

    pulley_radius_m: float = _positive()
    counts_per_turn: int = _positive()
    slack_count: int = _not_negative()
    torque_constant_nm_a: float = _positive()
    friction_current_a: float = _not_negative()
    max_speed_m_s: float = _positive()
    max_acceleration_m_s2: float = _positive()
    back_drive_n: float = _not_negative()
    back_drive_n_s_m: float = _positive()
    reboot_s: float = _not_negative()

    @property
    def m_per_count(self) -> float:
        """Tendon wound in by one count of the encoder [m]."""
        return 2 * math.pi * self.pulley_radius_m / self.counts_per_turn


@dataclass(frozen=True)
class LoadCell:
    """The load cell on the tendon."""

    rate_hz: float = _positive()
    clock_error_ppm: float = _any_number()
    noise_n: float = _not_negative()
    capacity_n: float = _positive()

    @property
    def period_s(self) -> float:
        """True time between two samples, the device clock's error included [s]."""
        return (1 + self.clock_error_ppm * 1e-6) / self.rate_hz


@dataclass(frozen=True)
class Placement:
    """What lies where in the guide's frame."""

    texture_guide_m: float = _not_negative()
    texture_lead_m: float = _not_negative()
    tray_depth_m: float = _positive()
    object_guide_m: float = _not_negative()
    object_half_width_m: float = _positive()


@dataclass(frozen=True)
class VariationSpread:
    """Standard deviations from trial to trial."""

    contact_height_m: float = _not_negative()
    placement_m: float = _not_negative()
    friction: float = _not_negative()
    stiffness: float = _not_negative()

    def __post_init__(self) -> None:
        if max(self.friction, self.stiffness) > 0.3:
            raise DescriptionError('a relative variation must be at most 0.3')


@dataclass(frozen=True)
class Rig:
    """Everything around the finger."""

    guide: Guide
    tendon: TendonDrive
    load_cell: LoadCell
    placement: Placement
    variation: VariationSpread
    friction_speed_m_s: float = _positive()
    tendon_friction_speed_m_s: float = _positive()


def parse_description(kind: type[_T], values: object, name: str) -> _T:
    """Build one frozen description from the values of a YAML mapping.

    Raises
    ------
    DescriptionError
        A key is missing or unknown, or a value is no number, not finite or out of range.
    """
    if not isinstance(values, Mapping):
        raise DescriptionError(f'{name} must be a mapping of names to values')
    hints = get_type_hints(kind)
    unknown, missing = sorted(set(values) - set(hints)), sorted(set(hints) - set(values))
    if unknown or missing:
        parts = [f'{k} is missing' for k in missing] + [f'{k} is unknown' for k in unknown]
        raise DescriptionError(f'{name}: {", ".join(parts)}')
    built: dict[str, Any] = {}
    for item in dataclasses.fields(kind):  # type: ignore[arg-type]
        where, value, wanted = f'{name}.{item.name}', values[item.name], hints[item.name]
        if isinstance(wanted, type) and dataclasses.is_dataclass(wanted):
            built[item.name] = parse_description(wanted, value, where)
        elif wanted is str:
            built[item.name] = str(value)
        else:
            built[item.name] = _parse_number(wanted, value, where, item.metadata)
    try:
        return kind(**built)
    except DescriptionError as error:
        raise DescriptionError(f'{name}: {error}') from None


def _parse_number(wanted: type, value: object, where: str, limits: Mapping[str, Any]) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise DescriptionError(f'{where} is {value!r}; it must be a finite number')
    if wanted is int and not isinstance(value, int):
        raise DescriptionError(f'{where} is {value!r}; it must be a whole number')
    if value <= limits.get('above', -math.inf):
        raise DescriptionError(f'{where} is {value}; it must be above {limits["above"]}')
    if value < limits.get('from', -math.inf):
        raise DescriptionError(f'{where} is {value}; it must be at least {limits["from"]}')
    return value if wanted is int else float(value)


@lru_cache
def _load_yaml(name: str) -> Any:
    return yaml.safe_load((_CONFIG / name).read_text(encoding='utf-8'))


@lru_cache
def load_finger(contact: str) -> Finger:
    """Load the finger for ``flexion`` or ``abduction``; DescriptionError otherwise."""
    if contact not in CONTACTS:
        raise DescriptionError(f'contact is {contact!r}; it must be one of {CONTACTS}')
    return parse_description(Finger, _load_yaml(f'finger_{contact}.yaml'), f'finger_{contact}')


@lru_cache
def load_rig() -> Rig:
    """Load the rig around the finger."""
    return parse_description(Rig, _load_yaml('rig.yaml'), 'rig')


def list_objects(protocol: str) -> tuple[str, ...]:
    """Labels that can be mounted for a protocol, in the paper's order."""
    if protocol not in PROTOCOLS:
        raise DescriptionError(f'protocol is {protocol!r}; it must be one of {PROTOCOLS}')
    return tuple(_load_yaml('plates.yaml' if protocol == 'texture' else 'objects.yaml'))


@lru_cache
def load_plate(label: str) -> Plate:
    """Load the texture plate of this label; DescriptionError if there is none."""
    return parse_description(Plate, _find('texture', 'plates.yaml', label), f'plate {label}')


@lru_cache
def load_body(label: str) -> Body:
    """Load the stiffness object of this label; DescriptionError if there is none."""
    return parse_description(Body, _find('stiffness', 'objects.yaml', label), f'object {label}')


def _find(protocol: str, file_name: str, label: str) -> object:
    try:
        return _load_yaml(file_name)[label]
    except KeyError:
        labels = ', '.join(list_objects(protocol))
        raise DescriptionError(f'no {protocol} object {label!r}; there are {labels}') from None
