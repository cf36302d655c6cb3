# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Computation on a Dask cluster, through joblib's own backend."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from tactile_ros.errors import TactileError

TIMEOUT_S = 15.0
"""Longest wait for the scheduler [s]."""


@contextmanager
def on_cluster(address: str) -> Iterator[None]:
    """Send joblib's work to a cluster. If the address is empty, use this computer.

    The results do not depend on the number and place of the workers.

    Parameters
    ----------
    address : str
        Address of the scheduler, such as ``tcp://192.168.1.10:8786``.

    Raises
    ------
    TactileError
        When Dask is not installed, joblib is too old, or no scheduler with workers responds.
    """
    if not address:
        yield
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise TactileError(
            '--cluster needs Dask: pip install "dask[distributed]", here and on the workers'
        ) from error
    from joblib import __version__, parallel_config

    # In older versions, the Dask backend returns no result before the last one is finished.
    if tuple(map(int, __version__.split('.')[:2])) < (1, 4):
        raise TactileError(
            f'--cluster needs joblib 1.4 or later, and this is {__version__}: '
            'pip install "joblib>=1.4", here and on the workers'
        )
    try:
        client = Client(address, timeout=TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise TactileError(f'no Dask scheduler responds at {address}: {error}') from error
    with client:
        if not client.scheduler_info()['workers']:
            raise TactileError(f'the Dask scheduler at {address} has no workers; start some')
        with parallel_config('dask'):
            yield
