# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reading and writing model files: a manifest, a card, and arrays.

The name of an array consists of the part of the model and the field of its class, for example
``classifier.trials``, ``scaling.mean`` and ``novelty.centre``.
"""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from tactile_classifier.confidence.calibration import Calibration
from tactile_classifier.confidence.novelty import NoveltyMeasure
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.manifest import format_card, Manifest
from tactile_classifier.model_file.prediction import (
    Classifier,
    Convolutions,
    LinearMachine,
    Neighbours,
    Predictor,
    RadialMachine,
    Scaling,
    Tree,
)
from tactile_classifier.types import PROBABILITY, ROCKET
from tactile_features.model_container import open_container, pack_container

MAX_CARD_BYTES = 64 * 2**10
"""If the card of a file is larger, the file is refused [byte]."""

CARD = 'card'

_CLASSIFIERS: dict[str, type[Classifier]] = {
    'knn': Neighbours,
    'svm_linear': LinearMachine,
    'svm_rbf': RadialMachine,
    'tree': Tree,
    ROCKET: Convolutions,
}
_DTYPES = {'Matrix': '<f8', 'Single': '<f4', 'Indices': '<i8'}

Arrays = dict[str, npt.NDArray[Any]]

_Part = TypeVar('_Part', Classifier, Scaling, NoveltyMeasure)


@dataclasses.dataclass(frozen=True, eq=False)
class ModelContents:
    """Manifest, card and predictor of a model."""

    manifest: Manifest
    card: str
    predictor: Predictor


def pack_model(manifest: Manifest, predictor: Predictor) -> bytes:
    """Return the bytes of a model file; raise ModelFileError if it would be too large."""
    arrays: Arrays = {}
    for name in ('classifier', 'scaling', 'novelty'):
        part = getattr(predictor, name)
        if part is not None:
            arrays |= _take_arrays(part, f'{name}.')
    return pack_container({**manifest.to_dict(), CARD: format_card(manifest)}, arrays)


def open_model(data: bytes) -> ModelContents:
    """Return the contents of a model file; raise ModelFileError if it is invalid.

    Types, shapes and values are checked, and all numbers must be finite. The time of a prediction
    is therefore bounded by the size of the file.
    """
    entries, arrays = open_container(data)
    card = entries.pop(CARD, '')
    if not isinstance(card, str) or not card.replace('\n', '').isprintable():
        # Control characters could be commands to the terminal that shows the card.
        raise ModelFileError('its card is not plain text')
    if len(card.encode()) > MAX_CARD_BYTES:
        raise ModelFileError(f'its card has more than {MAX_CARD_BYTES >> 10} KiB')
    manifest = Manifest.from_dict(entries)
    predictor = _read_predictor(manifest, arrays)
    if arrays:
        raise ModelFileError(f'it contains the unexpected array "{min(arrays)}"')
    return ModelContents(manifest, card, predictor)


def _take_arrays(part: Any, prefix: str) -> Arrays:
    types = type(part).__annotations__
    return {
        f'{prefix}{name}': np.asarray(getattr(part, name), _DTYPES[types[name]])
        for name in part.SHAPES
    }


def _read_predictor(manifest: Manifest, arrays: Arrays) -> Predictor:
    """Return the predictor, and remove its arrays from ``arrays``."""
    stated = manifest.confidence
    if (manifest.score_kind == PROBABILITY) != (stated.slope > 0.0):
        raise ModelFileError('its calibration and its kind of scores are inconsistent')
    sizes: dict[str | int, int] = {'k': len(manifest.spec.names), 'labels': len(manifest.labels)}

    def read(kind: type[_Part], name: str) -> _Part:
        return _read_part(kind, f'{name}.', arrays, dict(sizes))

    return Predictor(
        classifier=read(_CLASSIFIERS[manifest.classifier], 'classifier'),
        scaling=read(Scaling, 'scaling') if manifest.scaling == 'standard' else None,
        calibration=Calibration(stated.slope, stated.offset) if stated.slope > 0.0 else None,
        novelty=read(NoveltyMeasure, 'novelty') if stated.novelty_threshold >= 0.0 else None,
    )


def _read_part(
    kind: type[_Part], prefix: str, arrays: Arrays, sizes: dict[str | int, int]
) -> _Part:
    fields: Arrays = {}
    for name, dimensions in kind.SHAPES.items():
        array = arrays.pop(f'{prefix}{name}', None)
        wanted = np.dtype(_DTYPES[kind.__annotations__[name]])
        if array is None:
            raise ModelFileError(f'it has no array "{prefix}{name}"')
        if array.dtype != wanted:
            raise ModelFileError(
                f'its array "{prefix}{name}" has type {array.dtype}, not {wanted}'
            )
        for size, dimension in zip(array.shape, dimensions, strict=False):
            if isinstance(dimension, str):
                sizes.setdefault(dimension, size)
        shape = tuple(d if isinstance(d, int) else sizes.get(d, -1) for d in dimensions)
        if array.shape != shape:
            raise ModelFileError(
                f'its array "{prefix}{name}" has shape {array.shape}; it must be {shape}, '
                f'that is ({", ".join(map(str, dimensions))})'
            )
        if not np.isfinite(array).all():
            raise ModelFileError(f'its array "{prefix}{name}" has values that are not finite')
        fields[name] = array
    part = kind(**fields)
    try:
        part.check(sizes['k'], sizes['labels'])
    except ModelFileError as error:
        raise ModelFileError(f'{error} ({prefix.rstrip(".")})') from None
    return part
