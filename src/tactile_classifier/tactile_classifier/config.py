# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the classifier node, without ROS."""

from __future__ import annotations

import dataclasses

from tactile_classifier.types import CONTACTS
from tactile_ros.configs import parameter


@dataclasses.dataclass(frozen=True)
class ClassifierConfig:
    """Parameters of the classifier node."""

    models: str = parameter('', 'folder with model files (*.npz), or one file; all are used')
    contact: str = parameter(
        '',
        'use only models and windows of this contact; if empty, all contacts are allowed',
        choices=('', *CONTACTS),
    )
