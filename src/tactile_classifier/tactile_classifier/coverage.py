# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measured coverage of the intervals of accuracies, for cards and reports."""

from __future__ import annotations

from collections.abc import Iterable

COVERAGE_WITH_TRAINING = (0.84, 0.95)
"""Minimum and maximum of the measured coverage of intervals over held-out groups [1]. The coverage
is below the nominal one, because the folds share most of their training trials; see
docs/evaluation.md."""

COVERAGE_OF_CHOICE = (0.87, 0.88)
"""Minimum and maximum of the coverage measured for nested accuracies of automatic choices [1]."""


def format_coverage(spread_of: str, means: Iterable[float], *, chosen: bool = False) -> str:
    """Return the measured coverage of intervals of accuracies as a clause, or an empty string.

    The coverage is known for intervals over held-out groups (``spread_of`` is ``groups``). The
    exact binomial interval, which is used if all groups are at 0 or 100 %, was not measured.
    ``chosen`` is True for the nested accuracy of an automatic choice.
    """
    if spread_of != 'groups' or all(mean in (0.0, 1.0) for mean in means):
        return ''
    least, most = COVERAGE_OF_CHOICE if chosen else COVERAGE_WITH_TRAINING
    return (
        f'; such intervals contained the true accuracy in {100 * least:.0f} to {100 * most:.0f} % '
        'of simulated experiments'
    )
