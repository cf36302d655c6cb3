# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sets of features, one module each, and the registry that finds them by name."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'Feature': 'feature_set',
    'FeatureSet': 'feature_set',
    'WindowSamples': 'feature_set',
    'WindowSpec': 'feature_set',
    'find_feature_set': 'registry',
    'list_feature_sets': 'registry',
    'task_of': 'registry',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # On first use: the registry imports every set, and with them SciPy.
    if name in _HOMES:
        return getattr(importlib.import_module(f'{__name__}.{_HOMES[name]}'), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')
