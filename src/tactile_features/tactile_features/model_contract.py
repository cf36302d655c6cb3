# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The part of a model file that the feature node reads: task, contact and specification.

`tactile_classifier` reads the other entries.
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
from tactile_features.spec import FeatureSpec
from tactile_features.types import CONTACT_ABDUCTION, CONTACT_FLEXION, contacts_agree

FORMAT_VERSION = 9
"""Version of the manifest of a model file."""

DIGEST = 'specification_digest'
"""Manifest entry with the digest of the feature specification."""

LONGEST_BUFFER_S = 600.0
"""Largest buffer; every window that a feature node can compute fits into it [s]."""

MOST_NAMED = 5
"""One error describes at most this number of refused files, and counts the others."""


@dataclass(frozen=True)
class ModelContract:
    """The features that a model file needs.

    Attributes
    ----------
    task, contact : str
        ``contact`` is empty for a model of any contact.
    spec : FeatureSpec
    """

    task: str
    contact: str
    spec: FeatureSpec


@dataclass(frozen=True)
class FeaturePlan:
    """The features that a node computes for model files.

    Attributes
    ----------
    specs : tuple of FeatureSpec
    refused : tuple of str
        One sentence for each model file that cannot be used.
    overruled : tuple of str
        The node's parameters that the models override, as ``name 90 (not 180)``.
    """

    specs: tuple[FeatureSpec, ...] = ()
    refused: tuple[str, ...] = ()
    overruled: tuple[str, ...] = ()


def plan_features(config: FeatureConfig, models: str | Path, contact: str = '') -> FeaturePlan:
    """Return the features that model files need; if ``models`` is empty, the plan is empty.

    Raises `ModelFileError` when no file is usable.
    """
    if not str(models):
        return FeaturePlan()
    contracts, refused = read_contracts(models, contact, config)
    specs = tuple(contract.spec for contract in contracts)
    return FeaturePlan(specs, tuple(refused), _find_overruled(config, specs))


def read_contracts(
    models: str | Path, contact: str = '', config: FeatureConfig | None = None
) -> tuple[list[ModelContract], list[str]]:
    """Return the contracts of model files, and one sentence for each unusable file.

    Parameters
    ----------
    models : str or Path
        A folder with ``*.npz`` files, or one file.
    contact : str
        Ignore models of another contact; if empty, models of any contact are used.
    config : FeatureConfig, optional
        Parameters of a node. Models whose features it cannot compute with them are refused. By
        default, only features that no node can compute are refused.

    Raises
    ------
    ModelFileError
        When no file is usable.
    """
    limits = config or FeatureConfig(buffer_s=LONGEST_BUFFER_S)

    def load(path: Path) -> ModelContract:
        with refusals_of(path):
            fields = check_version(read_container(path).manifest)
            spec = parse_spec(fields)
            spec.bind(limits)
            return ModelContract(fields['task'], fields['contact'], spec)

    return load_usable(models, contact, load)


def check_version(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of a manifest after checking only its format version."""
    fields = dict(manifest)
    version = fields.pop('format_version', None)
    if version != FORMAT_VERSION:
        raise ModelFileError(
            f'it has format version {version}, this software reads {FORMAT_VERSION}: train the '
            'model again'
        )
    return fields


def parse_spec(fields: Mapping[str, Any]) -> FeatureSpec:
    """Return the feature specification of a manifest, after checking its task and contact."""
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
            f'its {DIGEST} does not match its feature specification: one of them was changed'
        )
    _check_contract(fields['task'], fields['contact'], spec)
    return spec


def _check_contract(task: str, contact: str, spec: FeatureSpec) -> None:
    of_set = task_of(spec.feature_set)
    if not of_set:
        raise ModelFileError(
            f'its feature set "{spec.feature_set}" is not installed: install the '
            'package that the model was trained with'
        )
    if of_set != task:
        raise ModelFileError(
            f'its task "{task}" does not fit its feature set "{spec.feature_set}"'
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
    """Load all model files; return the results, and one sentence for each refused file.

    The parameters ``models`` and ``contact`` are as in `read_contracts`. To refuse a file,
    ``load`` raises `ModelFileError`. If no file is usable, this function raises it.
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
            f'the models in {models} are for {" and ".join(sorted(others))}, but the parameter '
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
    # ONNX files of an earlier version are listed, so that they are refused with a reason.
    files = sorted(f for f in path.iterdir() if f.suffix in ('.npz', '.onnx') and f.is_file())
    if not files:
        raise ModelFileError(
            f'there are no model files (*.npz) in {path}; `tactile train` writes them'
        )
    return files


@contextmanager
def refusals_of(path: str | Path) -> Iterator[None]:
    """Convert errors in a ``with`` block to `ModelFileError` with the name of the file."""
    try:
        yield
    except OSError as error:
        raise ModelFileError(f'cannot read model {path}: {error.strerror}') from error
    except FeatureError as error:
        raise ModelFileError(f'model {path} is refused: {error}') from error


def _find_overruled(config: FeatureConfig, specs: Sequence[FeatureSpec]) -> tuple[str, ...]:
    """Return the parameters whose values differ from those in the specifications of the models."""
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
