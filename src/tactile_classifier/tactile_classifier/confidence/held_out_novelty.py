# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Thresholds for "unknown" and p-values, from novelties of held-out trials of known labels."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import ModelFileError, refuse_damage, TooFewTrialsError

Matrix = npt.NDArray[np.float64]

SESSIONS_BEYOND = 0.1
"""Largest fraction of new sessions in which the strict threshold may reject too many trials.

The threshold is computed from at least nine sessions; if there are fewer, the fraction is larger.
"""


def trials_needed(rate: float) -> int:
    """Return the smallest number of trials for a conformal threshold with this rejection rate."""
    return math.ceil(round(1.0 / rate, 9)) - 1


def rank_of_sessions(count: int) -> int:
    """Return the rank of the quantile that is used as strict threshold, from 1 for the smallest.

    There is one quantile for each of ``count`` sessions. If a new session is exchangeable with
    them, the probability that its quantile is at most the threshold is ``rank / (count + 1)``. If
    there are nine or more sessions, this is at least 1 - `SESSIONS_BEYOND`. If there are fewer,
    the largest quantile is used, and the probability is ``count / (count + 1)``.
    """
    return min(count, math.ceil(round((count + 1) * (1.0 - SESSIONS_BEYOND), 9)))


@dataclasses.dataclass(frozen=True, eq=False)
class HeldOutNovelty:
    """Novelties of held-out trials of known labels, and the thresholds computed from them.

    The measure was fitted neither to these trials nor to other trials of their session.

    Attributes
    ----------
    sessions : tuple of arrays
        Novelties of the trials of each session. If sessions are not used, one array with all
        trials.
    names : tuple of str
        Names of the sessions; empty if sessions are not used.
    """

    sessions: tuple[Matrix, ...]
    names: tuple[str, ...] = ()

    def compute_threshold(self, rate: float, *, strict: bool = False) -> float:
        """Return the novelty above which a window is unknown.

        By default, the threshold is the quantile over all trials, with the same total weight for
        each session. The false rejection rate then holds on average over sessions. If sessions are
        not used, the threshold is the ``ceil((n + 1) * (1 - rate))``-th smallest of ``n``
        novelties. The probability that a new, exchangeable trial exceeds it is at most ``rate``
        (split conformal prediction: Vovk, Gammerman and Shafer 2005; Lei et al. 2018).

        With the strict threshold, the false rejection rate holds in most new sessions. One
        quantile is computed for each session, and the threshold is the quantile with the rank
        `rank_of_sessions` (Dunn, Wasserman and Ramdas 2022; for environments, Duchi, Gupta, Jiang
        and Sur 2024). With probability ``rank / (count + 1)``, the quantile of a new session does
        not exceed it. If a session has fewer trials than `trials_needed`, its largest novelty is
        used as its quantile.

        Parameters
        ----------
        rate : float
            False rejection rate, between 0 and 1 [1].
        strict : bool
            Return the strict threshold.

        Raises
        ------
        TooFewTrialsError
            If there are fewer than `trials_needed` trials in total.
        """
        count = sum(map(len, self.sessions))
        needed = trials_needed(rate)
        if count < needed:
            raise TooFewTrialsError(
                f'a threshold with a false rejection rate of {rate:g} needs {needed} '
                f'trial{"s" * (needed != 1)}, but the number of held-out trials is {count}'
            )
        return _find_threshold(self.sessions, rate, strict)

    def reject_sessions(self, rate: float, *, strict: bool = False) -> tuple[float, ...]:
        """Compute the false rejection rate of each session with the other sessions' threshold [1].

        If there are fewer than two sessions, the result is empty.
        """
        if len(self.names) < 2:
            return ()
        found = []
        for i, one in enumerate(self.sessions):
            others = self.sessions[:i] + self.sessions[i + 1 :]
            found.append(float(np.mean(one > _find_threshold(others, rate, strict))))
        return tuple(found)

    def compute_p_value(self, novelty: float, *, strict: bool = False) -> float:
        """Return the conformal p-value of a novelty [1].

        The p-value is at most the false rejection rate if and only if the novelty exceeds the
        threshold for this rate. If ``strict`` is True, this is true only if each session has at
        least `trials_needed` trials.
        """
        shares = [float(np.mean(each >= novelty)) for each in self.sessions]
        sizes = [len(each) for each in self.sessions]
        if strict:
            of_sessions = (
                (1 + size * share) / (1 + size) for size, share in zip(sizes, shares, strict=True)
            )
            return sorted(of_sessions)[rank_of_sessions(len(sizes)) - 1]
        count = sum(sizes)
        return round((1 + count * float(np.mean(shares))) / (1 + count), 12)

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON, which `read` converts back."""
        return {
            'names': list(self.names),
            'sessions': [np.sort(x).tolist() for x in self.sessions],
        }

    @classmethod
    def read(cls, entry: Any) -> HeldOutNovelty:
        """Return the novelties from a dictionary of `to_dict`; raise ModelFileError if invalid."""
        with refuse_damage('its novelties of held-out trials are'):
            sessions = tuple(np.array(each, dtype=np.float64) for each in entry['sessions'])
            names = tuple(entry['names'])
            are_flat = all(each.ndim == 1 and len(each) for each in sessions)
            are_finite = all(np.isfinite(each).all() for each in sessions)
            are_named = len(sessions) == max(len(names), 1) and all(type(x) is str for x in names)
            if are_flat and are_finite and are_named:
                return cls(sessions, names)
        raise ModelFileError('its novelties of held-out trials are damaged')


def _find_threshold(sessions: Sequence[Matrix], rate: float, strict: bool) -> float:
    """Return the threshold of `compute_threshold`, without an error for too few trials."""
    if strict:
        quantiles = sorted(_find_quantile([each], rate) for each in sessions)
        return quantiles[rank_of_sessions(len(quantiles)) - 1]
    return _find_quantile(sessions, rate)


def _find_quantile(sessions: Sequence[Matrix], rate: float) -> float:
    """Return the smallest novelty that is exceeded by at most the allowed fraction of trials."""
    novelty = np.concatenate(sessions)
    weight = np.concatenate([np.full(len(x), 1.0 / (len(sessions) * len(x))) for x in sessions])
    order = np.argsort(novelty)
    above = 1.0 - np.cumsum(weight[order])
    allowed = max((rate * (len(novelty) + 1) - 1.0) / len(novelty), 0.0)
    return float(novelty[order][int(np.argmax(above <= allowed + 1e-9))])
