# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writer of tables."""

from typing import Any


def load_pyarrow() -> Any:
    """Return pyarrow with its readers."""
    import pyarrow
    import pyarrow.csv
    import pyarrow.parquet

    return pyarrow
