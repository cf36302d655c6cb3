# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Descriptions of fingers, rig, plates and objects: packaged files, and files of the user."""

from __future__ import annotations

from collections.abc import Mapping
import copy
import dataclasses
from dataclasses import dataclass, field
from functools import lru_cache
import hashlib
import math
from pathlib import Path
import re
from typing import Any, get_args, get_origin, get_type_hints, TypeVar

from tactile_ros.configs import find_violation
from tactile_ros.errors import TactileError
from tactile_ros.yaml_files import load_yaml, read_text
from tactile_sim.descriptions.description import (
    Body,
    CONTACTS,
    Finger,
    Plate,
    PROTOCOLS,
    Rig,
)
from tactile_sim.errors import DescriptionError

_T = TypeVar('_T')
_Files = dict[str, tuple[str, dict[str, Any]]]
"""Files of the user by name: the path, and the values that were read."""

_LONGEST_SHOWN = 40
_LARGEST_BYTES = 1 << 20
_MOST_LABELS = 1000
_LABEL = re.compile(r'[A-Za-z0-9][A-Za-z0-9_.-]{0,63}\Z')
_KEYED = ('finger_abduction.yaml', 'finger_flexion.yaml', 'rig.yaml')
_LABELLED = {'texture': 'plates.yaml', 'stiffness': 'objects.yaml'}
_GRAVITY_M_S2 = 9.80665
# Random deviations are limited to this number of standard deviations, on each level of variation
# (trial, mounting and session).
_WIDEST = 3.0


def _parse_text(text: str, name: str) -> dict[str, Any]:
    """Parse a YAML text that contains a mapping.

    ``name`` is the name of the file for error messages. Raises `DescriptionError` when the text is
    not a mapping.
    """
    try:
        values = load_yaml(text)
    except TactileError as error:
        raise DescriptionError(f'{name}: {error}') from None
    if not isinstance(values, dict):
        raise DescriptionError(f'{name} must be a mapping; see the packaged descriptions')
    return values


def parse_description(kind: type[_T], values: object, name: str) -> _T:
    """Build a description, which is an instance of the dataclass ``kind``, from plain values.

    Raises `DescriptionError` when a key is missing or unknown, or a value has the wrong type or is
    out of range.
    """
    if not isinstance(values, Mapping) or not all(isinstance(key, str) for key in values):
        raise DescriptionError(f'{name} must be a mapping of names to values')
    fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    needed = {key for key, field in fields.items() if field.default is dataclasses.MISSING}
    missing, unknown = sorted(needed - set(values)), sorted(set(values) - set(fields))
    if missing or unknown:
        parts = [f'{key} is missing' for key in missing]
        parts += [f'{show(key)} is unknown; use {", ".join(fields)}' for key in unknown]
        raise DescriptionError(f'{name}: {"; ".join(parts)}')
    hints = get_type_hints(kind)
    built = {
        key: _parse_value(hints[key], value, f'{name}.{key}') for key, value in values.items()
    }
    for key, value in built.items():
        if violation := find_violation(fields[key], value):
            raise DescriptionError(f'{name}.{violation}')
    try:
        return kind(**built)
    except DescriptionError as error:
        raise DescriptionError(f'{name}: {error}') from None


def show(value: object) -> str:
    """Format a value for an error message; a long text is truncated."""
    text = ascii(value)
    return text if len(text) <= _LONGEST_SHOWN else f'{text[:_LONGEST_SHOWN]}...'


def _parse_value(wanted: Any, value: object, where: str) -> Any:
    if dataclasses.is_dataclass(wanted):
        return parse_description(wanted, value, where)  # type: ignore[arg-type]
    if get_origin(wanted) is tuple:
        return _parse_list(get_args(wanted), value, where)
    if wanted is str:
        if not isinstance(value, str):
            raise DescriptionError(f'{where} is {show(value)}; it must be a word')
        return value
    return _parse_number(wanted, value, where)


def _parse_list(kinds: tuple[Any, ...], value: object, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise DescriptionError(f'{where} is {show(value)}; it must be a list, such as []')
    if kinds[1:] == (...,):
        kinds = (kinds[0],) * len(value)
    elif len(value) != len(kinds):
        raise DescriptionError(f'{where} has {len(value)} entries; it must have {len(kinds)}')
    pairs = zip(kinds, value, strict=True)
    return tuple(_parse_value(kind, v, f'{where}[{i}]') for i, (kind, v) in enumerate(pairs))


def _parse_number(wanted: type, value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise DescriptionError(f'{where} is {show(value)}; it must be a finite number')
    if wanted is int and not isinstance(value, int):
        raise DescriptionError(f'{where} is {value!r}; it must be a whole number')
    return value if wanted is int else float(value)


_PACKAGED = Path(__file__).resolve().parents[1] / 'config'


@dataclass(frozen=True, init=False)
class Catalogue:
    """Descriptions of all fingers, plates and objects that can be simulated, and of the rig.

    The catalogue is small, hashable and picklable. It contains the values that its files had when
    it was created, so that another process can use it without the files.

    Parameters
    ----------
    folder : Path or None
        Folder of the user. Its files override the packaged files with the same name, which are in
        the folder ``config``. Files of the rig and of the fingers override single values; files of
        plates and objects override whole entries. If None, only the packaged files are used.

    Raises
    ------
    DescriptionError
        When the folder or a file in it is unusable; the message names file, label and key.
    """

    _fingers: tuple[tuple[str, Finger], ...] = field(repr=False)
    _rig: Rig = field(repr=False)
    _plates: tuple[tuple[str, Plate], ...] = field(repr=False)
    _bodies: tuple[tuple[str, Body], ...] = field(repr=False)

    def __init__(self, folder: Path | None = None) -> None:
        files = {} if folder is None else _read_folder(folder)
        rig = _parse_keyed(Rig, 'rig.yaml', files)
        fingers = []
        for contact in CONTACTS:
            name = f'finger_{contact}.yaml'
            finger = _parse_keyed(Finger, name, files)
            _check_finger(finger, rig, files.get(name, (name,))[0])
            fingers.append((contact, finger))
        values = {
            '_fingers': tuple(fingers),
            '_rig': rig,
            '_plates': _parse_labelled(Plate, _LABELLED['texture'], files),
            '_bodies': _parse_labelled(Body, _LABELLED['stiffness'], files),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)  # the dataclass is frozen

    @property
    def digest(self) -> str:
        """SHA-256 digest of the contents of the catalogue."""
        shelves = (self._fingers, self._rig, self._plates, self._bodies)
        return hashlib.sha256(repr(shelves).encode()).hexdigest()

    def finger(self, contact: str) -> Finger:
        """Return the finger for this contact; raise DescriptionError for an unknown contact."""
        if contact not in CONTACTS:
            raise DescriptionError(f'contact is {show(contact)}; it must be one of {CONTACTS}')
        return dict(self._fingers)[contact]

    def rig(self) -> Rig:
        """Return the description of the rig."""
        return self._rig

    def with_rig(self, rig: Rig) -> Catalogue:
        """Return a copy of the catalogue that has another rig."""
        other = copy.copy(self)
        object.__setattr__(other, '_rig', rig)
        return other

    def plate(self, label: str) -> Plate:
        """Return the texture plate of this label; raise DescriptionError if there is none."""
        return _find(self._plates, label, 'texture plate')

    def body(self, label: str) -> Body:
        """Return the stiffness object of this label; raise DescriptionError if there is none."""
        return _find(self._bodies, label, 'stiffness object')

    def check_mount(self, protocol: str, label: str, contact: str) -> None:
        """Raise `DescriptionError` if the protocol, label or contact is unknown."""
        self.labels(protocol)
        (self.plate if protocol == 'texture' else self.body)(label)
        self.finger(contact)

    def labels(self, protocol: str) -> tuple[str, ...]:
        """Return the labels of the plates or objects that a protocol uses.

        The packaged labels come first, in the order of the paper. Raises `DescriptionError` for an
        unknown protocol.
        """
        if protocol not in PROTOCOLS:
            raise DescriptionError(f'protocol is {show(protocol)}; it must be one of {PROTOCOLS}')
        shelves = (self._plates, self._bodies)
        return tuple(label for label, _ in shelves[PROTOCOLS.index(protocol)])


@lru_cache
def default_catalogue() -> Catalogue:
    """Return the catalogue of the packaged descriptions."""
    return Catalogue()


def list_objects(protocol: str) -> tuple[str, ...]:
    """Return the packaged labels of plates or objects that a protocol uses.

    Raises `DescriptionError` for an unknown protocol.
    """
    return default_catalogue().labels(protocol)


def _find(shelf: tuple[tuple[str, _T], ...], label: str, what: str) -> _T:
    for known, description in shelf:
        if known == label:
            return description
    labels = ', '.join(known for known, _ in shelf)
    raise DescriptionError(f'unknown {what} {show(label)}; use {labels}')


def _read_folder(folder: Path) -> _Files:
    """Read and parse all files in the user's folder of descriptions."""
    known = sorted((*_KEYED, *_LABELLED.values()))
    try:
        names = sorted(path.name for path in folder.iterdir() if not path.name.startswith('.'))
    except OSError as error:
        raise DescriptionError(
            f'cannot read the folder of descriptions {folder}: {error.strerror}; choose a folder '
            f'with any of {", ".join(known)}'
        ) from None
    files = {}
    for name in names:
        if name not in known:
            raise DescriptionError(
                f'{folder} contains {show(name)}, which is not a description; remove it. '
                f'Descriptions are {", ".join(known)}'
            )
        path = folder / name
        try:
            text = read_text(path, _LARGEST_BYTES)
        except TactileError as error:
            raise DescriptionError(f'cannot read {path}: {error}') from None
        files[name] = (str(path), _parse_text(text, str(path)))
    return files


@lru_cache
def _read_packaged(name: str) -> Mapping[str, Any]:
    return _parse_text((_PACKAGED / name).read_text(encoding='utf-8'), name)


def _parse_keyed(kind: type[_T], name: str, files: _Files) -> _T:
    where, own = files.get(name, (name, {}))
    return parse_description(kind, _lay_over(_read_packaged(name), own), where)


def _lay_over(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of ``below`` in which ``above`` overrides values, also in nested mappings."""
    merged = dict(below)
    for key, value in above.items():
        under = below.get(key)
        both = isinstance(under, Mapping) and isinstance(value, Mapping)
        merged[key] = _lay_over(under, value) if both else value  # type: ignore[arg-type]
    return merged


def _parse_labelled(kind: type[_T], name: str, files: _Files) -> tuple[tuple[str, _T], ...]:
    where, own = files.get(name, (name, {}))
    if len(own) > _MOST_LABELS:
        raise DescriptionError(f'{where} has {len(own)} labels; the limit is {_MOST_LABELS}')
    for label in own:
        if not (isinstance(label, str) and _LABEL.match(label)):
            raise DescriptionError(
                f'{where}: the label {show(label)} must be 1 to 64 letters, digits, _, - and ., '
                'and start with a letter or digit'
            )
    return tuple(
        (label, parse_description(kind, values, f'{where if label in own else name}: {label}'))
        for label, values in {**_read_packaged(name), **own}.items()
    )


def _check_finger(finger: Finger, rig: Rig, where: str) -> None:
    """Raise `DescriptionError` if the tendon cannot bend the finger to its contact bend."""
    bend_rad = math.radians(finger.contact_bend_deg)
    moment_nm = finger.bending_stiffness_nm_rad * bend_rad - _compute_weight_nm(finger, bend_rad)
    if moment_nm <= 0.0:
        raise DescriptionError(
            f'{where}: the weight of the finger already bends it beyond contact_bend_deg; raise '
            'bending_stiffness_nm_rad, or lower mass_kg, tip_mass_kg or length_m'
        )
    tension_n = moment_nm / finger.moment_arm_m
    if tension_n >= rig.load_cell.capacity_n:
        raise DescriptionError(
            f'{where}: the finger needs {tension_n:.3g} N for its contact_bend_deg, but '
            f'load_cell.capacity_n is {rig.load_cell.capacity_n:g}; lower '
            'bending_stiffness_nm_rad or contact_bend_deg, or raise moment_arm_m'
        )
    spread = rig.variation
    levels = (spread.trial, spread.mounting, spread.session)
    widest_k = _WIDEST * sum(level.temperature_k for level in levels)
    if abs(finger.stiffness_per_k) * widest_k > 0.9:
        raise DescriptionError(
            f'{where}: stiffness_per_k is {finger.stiffness_per_k:g}, and the temperature may '
            f'deviate by {widest_k:g} K; lower stiffness_per_k, or temperature_k of the rig, so '
            'that the product of both numbers stays below 0.9'
        )


def _compute_weight_nm(finger: Finger, bend_rad: float) -> float:
    """Return the bending moment of the weight of a finger with constant curvature [N m].

    It is the derivative of the potential energy by the bend q. For the length L, the tip is
    lowered by L (1 - cos q) / q, and the finger by L (1 - sin q / q) / q on average.
    """
    q, ell = bend_rad, finger.length_m
    tip = ell * (q * math.sin(q) - 1 + math.cos(q)) / q**2
    mean = ell * (2 * math.sin(q) - q * math.cos(q) - q) / q**3
    return _GRAVITY_M_S2 * (finger.mass_kg * mean + finger.tip_mass_kg * tip)
