# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Work of a command on a Dask cluster, through joblib's own backend."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from tactile_ros.errors import TactileError

TIMEOUT_S = 15.0
"""How long the scheduler is waited for."""


@contextmanager
def on_cluster(address: str) -> Iterator[None]:
    """Send what joblib shares among workers to a cluster; an empty address: to this computer.

    Results are the same bits: no part depends on where it is computed.

    Parameters
    ----------
    address : str
        Of the scheduler, such as ``tcp://192.168.1.10:8786``.

    Raises
    ------
    TactileError
        When Dask is not installed, or no scheduler with workers answers.
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
    from joblib import parallel_config

    try:
        client = Client(address, timeout=TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise TactileError(f'no Dask scheduler answers at {address}: {error}') from error
    with client:
        if not client.scheduler_info()['workers']:
            raise TactileError(f'the Dask scheduler at {address} has no workers; start some')
        with parallel_config('dask'):
            yield
