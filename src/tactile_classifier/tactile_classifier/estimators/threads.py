# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Linear algebra on one thread.

The matrices of this package are small. OpenBLAS shares even these out among threads, which then
wait for each other: on two busy cores that took five times as long as one thread. One thread also
gives the same bits whatever the number of cores.
"""

from __future__ import annotations

from collections.abc import Callable
import functools
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

_Arguments = ParamSpec('_Arguments')
_Result = TypeVar('_Result')


def on_one_thread(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Decorate a function so that linear algebra keeps to one thread while it runs."""

    @functools.wraps(function)
    def limited(*args: _Arguments.args, **options: _Arguments.kwargs) -> _Result:
        # scikit-learn requires threadpoolctl, so it is there wherever that is.
        with threadpool_limits(1, user_api='blas'):
            return function(*args, **options)

    return limited
