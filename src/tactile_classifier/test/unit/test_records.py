# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import pytest

import tactile_classifier


def test_public_names_exist():
    for name in tactile_classifier.__all__:
        assert getattr(tactile_classifier, name) is not None
    with pytest.raises(AttributeError, match='has no attribute nonsense'):
        tactile_classifier.nonsense  # noqa: B018
