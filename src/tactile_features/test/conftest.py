# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixture that writes model files with only a manifest, which is all that the features need."""

from pathlib import Path
import sys

import pytest

from tactile_features.model_container import pack_container

# Helpers of several test files are in this folder, which is not part of the package.
sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def make_model_file():
    """Return a function that writes a model file, which requires the features of ``spec``."""

    def make(path, spec, contact='flexion', **changes):
        fields = {
            'format_version': 9,
            'task': spec.task,
            'contact': contact,
            'spec': spec.to_dict(),
            'specification_digest': spec.digest,
        }
        path.write_bytes(pack_container({**fields, **changes}, {}))
        return path

    return make
