# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Novelties of held-out trials of known labels: thresholds for "unknown", and p-values."""

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
"""Share of new sessions in which the strict threshold may fail, where sessions are enough."""


def trials_needed(rate: float) -> int:
    """Return how many calibration trials a conformal threshold at a rate needs at least."""
    return math.ceil(round(1.0 / rate, 9)) - 1


def rank_of_sessions(count: int) -> int:
    """Return the rank of the session whose quantile bounds the one of a new session.

    A further session, exchangeable with the ``count`` others, has a value at most the one of this
    rank with probability ``rank / (count + 1)``: 1 - `SESSIONS_BEYOND` of nine sessions or more,
    and ``count / (count + 1)``, by the largest value, of fewer.
    """
    return min(count, math.ceil(round((count + 1) * (1.0 - SESSIONS_BEYOND), 9)))


@dataclasses.dataclass(frozen=True, eq=False)
class HeldOutNovelty:
    """Novelties of held-out trials of known labels, and the thresholds that they give.

    Novelties are of trials that the measure was not fitted on, nor on their session.

    Attributes
    ----------
    sessions : tuple of arrays
        Novelties of the trials of each session, in one array without sessions.
    names : tuple of str
        Names of the sessions; empty without sessions.
    """

    sessions: tuple[Matrix, ...]
    names: tuple[str, ...] = ()

    @classmethod
    def divide(
        cls, novelty: Matrix, session: npt.NDArray[np.intp] | None, names: Sequence[str]
    ) -> HeldOutNovelty:
        """Return the novelties by session; ``session`` are positions in ``names``, or None."""
        if session is None:
            return cls((novelty,))
        found = np.unique(session)
        parts = tuple(novelty[session == i] for i in found)
        return cls(parts, tuple(names[i] for i in found))

    def compute_threshold(self, rate: float, *, strict: bool = False) -> float:
        """Return the novelty above which a window is unknown.

        By default the quantile over all trials, with the same weight for each session: the false
        rejection rate holds in the mean over sessions. Of ``n`` novelties without sessions it is
        the ``ceil((n + 1) * (1 - rate))``-th smallest: a further trial, exchangeable with these,
        lies above it with at most that probability (split conformal prediction: Vovk, Gammerman
        and Shafer 2005; Lei et al. 2018).

        The strict threshold holds in most new sessions: each session has its own quantile, and
        the threshold is the one of `rank_of_sessions` among these (Dunn, Wasserman and Ramdas
        2022; Duchi, Gupta, Jiang and Sur 2024, over environments). In a share ``rank / (count +
        1)`` of new sessions the quantile of their own trials is not above it. A session with fewer
        trials than `trials_needed` gives its largest novelty.

        Parameters
        ----------
        rate : float
            False rejection rate, between 0 and 1 [1].
        strict : bool

        Raises
        ------
        TooFewTrialsError
            When there are fewer than `trials_needed` in all.
        """
        count = sum(map(len, self.sessions))
        if count < trials_needed(rate):
            raise TooFewTrialsError(
                f'{count} trials cannot bound false rejection at {rate:g}; '
                f'{trials_needed(rate)} are needed'
            )
        return _find_threshold(self.sessions, rate, strict)

    def reject_sessions(self, rate: float, *, strict: bool = False) -> tuple[float, ...]:
        """Return the false rejection of each session by the threshold of the others [1].

        Empty with fewer than two sessions.
        """
        if len(self.names) < 2:
            return ()
        found = []
        for i, one in enumerate(self.sessions):
            others = self.sessions[:i] + self.sessions[i + 1 :]
            found.append(float(np.mean(one > _find_threshold(others, rate, strict))))
        return tuple(found)

    def compute_p_value(self, novelty: float, *, strict: bool = False) -> float:
        """Return the conformal p-value of a novelty, of which the threshold is a quantile.

        By default it is at most the false rejection rate exactly where the novelty is above the
        threshold. The strict one needs `trials_needed` in each session for this.
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
        """Return what JSON can hold; `read` is the inverse."""
        return {
            'names': list(self.names),
            'sessions': [np.sort(x).tolist() for x in self.sessions],
        }

    @classmethod
    def read(cls, entry: Any) -> HeldOutNovelty:
        """Return what `to_dict` gave; raise ModelFileError for anything else."""
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
    """Return the threshold of `compute_threshold`; of too few trials the largest novelty."""
    if strict:
        quantiles = sorted(_find_quantile([each], rate) for each in sessions)
        return quantiles[rank_of_sessions(len(quantiles)) - 1]
    return _find_quantile(sessions, rate)


def _find_quantile(sessions: Sequence[Matrix], rate: float) -> float:
    """Return the least novelty with at most the conformal share of the sessions' trials above."""
    novelty = np.concatenate(sessions)
    weight = np.concatenate([np.full(len(x), 1.0 / (len(sessions) * len(x))) for x in sessions])
    order = np.argsort(novelty)
    above = 1.0 - np.cumsum(weight[order])
    allowed = max((rate * (len(novelty) + 1) - 1.0) / len(novelty), 0.0)
    return float(novelty[order][int(np.argmax(above <= allowed + 1e-9))])
