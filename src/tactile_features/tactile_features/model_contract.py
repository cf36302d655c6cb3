# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The part of a model file that features need: task, contact, specification.

`tactile_classifier` reads the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError, ModelFileError
from tactile_features.feature_sets.registry import task_of
from tactile_features.model_container import read_container
from tactile_features.records import CONTACT_ABDUCTION, CONTACT_FLEXION, contacts_agree
from tactile_features.spec import FeatureSpec

FORMAT_VERSION = 8
"""Of the manifest in a model file."""

DIGEST = 'specification_digest'
"""Entry of a manifest: the digest of its specification."""

LONGEST_BUFFER_S = 600.0
"""A buffer in which every window fits that a feature node can compute [s]."""

MOST_NAMED = 5
"""Refused files that one error names; the others are counted."""


@dataclass(frozen=True)
class ModelContract:
    """The features that a model file asks for.

    Attributes
    ----------
    path : Path
    task, contact : str
        ``contact`` is empty for a model of any.
    spec : FeatureSpec
    """

    path: Path
    task: str
    contact: str
    spec: FeatureSpec


@dataclass(frozen=True)
class FeaturePlan:
    """The features that a node computes for model files.

    ``refused`` has one sentence for each file that cannot be used, ``overruled`` the parameters
    that the models decide otherwise than the node's, as ``name 90 (not 180)``.
    """

    specs: tuple[FeatureSpec, ...] = ()
    refused: tuple[str, ...] = ()
    overruled: tuple[str, ...] = ()


def plan_features(config: FeatureConfig, models: str | Path, contact: str = '') -> FeaturePlan:
    """Return the features that model files need of a node; none are needed without ``models``.

    When no file is usable, it is a `ModelFileError`.
    """
    if not str(models):
        return FeaturePlan()

    def load(path: Path) -> ModelContract:
        contract = read_contract(path)
        with refusals_of(path):
            contract.spec.bind(config)
        return contract

    contracts, refused = load_usable(models, contact, load)
    specs = tuple(contract.spec for contract in contracts)
    return FeaturePlan(specs, tuple(refused), _find_overruled(config, specs))


def read_contracts(models: str | Path, contact: str = '') -> tuple[list[ModelContract], list[str]]:
    """Return the contracts of model files, and one sentence for each file that is not usable.

    Parameters
    ----------
    models : str or Path
        A folder with ``*.npz`` files, or one file.
    contact : str
        Leave out models of another contact; empty: of none.

    Raises
    ------
    ModelFileError
        When no file is usable.
    """
    return load_usable(models, contact, read_contract)


def read_contract(path: Path) -> ModelContract:
    """Return the contract of a model file; `ModelFileError` when it cannot be used here."""
    with refusals_of(path):
        fields = check_version(read_container(path).manifest)
        spec = parse_spec(fields)
        spec.bind(FeatureConfig(buffer_s=LONGEST_BUFFER_S))
        return ModelContract(path, fields['task'], fields['contact'], spec)


def check_version(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of a manifest of this format version, not yet checked."""
    fields = dict(manifest)
    version = fields.pop('format_version', None)
    if version != FORMAT_VERSION:
        raise ModelFileError(
            f'it has format version {version}, this software reads {FORMAT_VERSION}: train the '
            'model again'
        )
    return fields


def parse_spec(fields: Mapping[str, Any]) -> FeatureSpec:
    """Return the features that the entries of a manifest ask for; check task and contact."""
    types = {'task': str, 'contact': str, 'spec': dict, DIGEST: str}
    for name, expected in types.items():
        if type(fields.get(name)) is not expected:
            raise ModelFileError(f'its manifest has no valid entry "{name}"')
    try:
        spec = FeatureSpec.from_dict(fields['spec'])
    except FeatureError as error:
        raise ModelFileError(f'its manifest is damaged: {error}') from error
    if fields[DIGEST] != spec.digest:
        raise ModelFileError(
            f'its {DIGEST} is not that of its feature specification: one of them was changed'
        )
    _check_contract(fields['task'], fields['contact'], spec)
    return spec


def _check_contract(task: str, contact: str, spec: FeatureSpec) -> None:
    of_set = task_of(spec.feature_set)
    if not of_set:
        raise ModelFileError(
            f'its feature set "{spec.feature_set}" is not installed here: install the '
            'package that it was trained with'
        )
    if of_set != task:
        raise ModelFileError(
            f'its task "{task}" does not go with its feature set "{spec.feature_set}"'
        )
    contacts = ('', CONTACT_FLEXION, CONTACT_ABDUCTION)
    if contact not in contacts:
        raise ModelFileError(
            f'its contact is "{contact}"; it must be {" or ".join(contacts[1:])}, or empty'
        )


class _OfContact(Protocol):
    @property
    def contact(self) -> str: ...


_Loaded = TypeVar('_Loaded', bound=_OfContact)


def load_usable(
    models: str | Path, contact: str, load: Callable[[Path], _Loaded]
) -> tuple[list[_Loaded], list[str]]:
    """Return what ``load`` makes of each model file, and one sentence for each that it refuses.

    Parameters are those of `read_contracts`. ``load`` raises `ModelFileError` for a file that it
    refuses; so does this when no file is usable.
    """
    loaded: list[_Loaded] = []
    refused: list[str] = []
    others: set[str] = set()
    for path in _list_files(models):
        try:
            model = load(path)
        except ModelFileError as error:
            refused.append(str(error))
            continue
        if contacts_agree(contact, model.contact):
            loaded.append(model)
        else:
            others.add(model.contact)
    if not loaded and others:
        refused.insert(
            0,
            f'the models in {models} are for {" and ".join(sorted(others))}, the parameter '
            f'contact is {contact}: change it, or train a model for {contact}',
        )
    if not loaded:
        more = f'; and {len(refused) - MOST_NAMED} more' * (len(refused) > MOST_NAMED)
        raise ModelFileError('; '.join(refused[:MOST_NAMED]) + more)
    return loaded, refused


def _list_files(models: str | Path) -> list[Path]:
    if not str(models):
        raise ModelFileError(
            'the parameter models is empty: it must be a folder with model files, or one file'
        )
    path = Path(models).absolute()
    if not path.is_dir():
        return [path]
    # ONNX files of an earlier version are refused by name.
    files = sorted(f for f in path.iterdir() if f.suffix in ('.npz', '.onnx') and f.is_file())
    if not files:
        raise ModelFileError(
            f'there are no model files (*.npz) in {path}; `tactile train` writes them'
        )
    return files


@contextmanager
def refusals_of(path: str | Path) -> Iterator[None]:
    """Name the file in errors about it."""
    try:
        yield
    except OSError as error:
        raise ModelFileError(f'cannot read model {path}: {error.strerror}') from error
    except FeatureError as error:
        raise ModelFileError(f'model {path} is refused: {error}') from error


def _find_overruled(config: FeatureConfig, specs: Sequence[FeatureSpec]) -> tuple[str, ...]:
    """Return the parameters that are stated otherwise than the models need them."""
    default, found = FeatureConfig(), []
    needed: dict[str, list[Any]] = {}
    for spec in specs:
        for name, value in spec.config_values().items():
            needed.setdefault(name, []).append(value)
    for name, values in needed.items():
        stated = getattr(config, name)
        if stated != getattr(default, name) and any(value != stated for value in values):
            texts = dict.fromkeys(str(value) for value in values)
            found.append(f'{name} {" and ".join(texts)} (not {stated})')
    return tuple(found)
