# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Model files that hold only a manifest: as much as features need."""

from pathlib import Path
import sys

import pytest

from tactile_features.model_container import pack_container

# What several test files share lies beside them and is no part of the package.
sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def make_model_file():
    """Return a writer of a file that asks for features."""

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
