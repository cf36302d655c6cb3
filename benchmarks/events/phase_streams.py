# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated sessions as continuous streams of samples, with the commanded phases of each trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tactile_bringup.trial_protocols import TrialConfig, TrialRequest
from tactile_features.types import TrialEvent
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_ros.strain import StrainBlock
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.physics.trials import simulate_trials

FloatArray = NDArray[np.float64]

SEED = 1001
"""Seed of the tested sessions. The constants of the detection were chosen with seed 1."""

TAUT_N = 0.01
"""The tendon counts as taut if its true tension exceeds the tension at rest by this value [N]."""


@dataclass(frozen=True)
class StatedTrial:
    """One trial of a stream, with its commanded phases.

    ``start_ns`` is the time of its first sample, and ``end_ns`` is the time of the first sample of
    the next trial [ns]. ``phases_ns`` has the time at which each phase was commanded [ns]. There
    are two exceptions: ``contact`` is the time at which the tendon became taut (after the
    command), and ``done`` is the time at which it became slack (before the command).
    """

    label: str
    start_ns: int
    end_ns: int
    phases_ns: Mapping[str, int]


@dataclass(frozen=True, eq=False)
class Session:
    """The trials of one session as a continuous stream.

    ``tension_n``, shape (n,), holds the readings of the load cell [N].
    """

    protocol: str
    contact: str
    period_ns: int
    tension_n: FloatArray
    trials: tuple[StatedTrial, ...]

    def events(self) -> list[TrialEvent]:
        """Return the events that the trial runner would publish."""
        return [
            TrialEvent(stamp_ns, f't{n}', '', self.protocol, self.contact, trial.label, phase)
            for n, trial in enumerate(self.trials)
            for phase, stamp_ns in trial.phases_ns.items()
        ]


@dataclass(frozen=True)
class Disturbance:
    """Disturbance that is added to the samples of a stream.

    ``noise_n`` is the standard deviation of the noise, including the noise of the simulated sensor
    [N]. ``drift_n_rt_s`` is the size of the random walk of the sensor's zero [N per root second].
    ``lost`` is the fraction of samples that are lost independently. If ``cut_share`` is below 1,
    readings are limited to this fraction of the maximum tension in the session.
    """

    noise_n: float = 0.004
    drift_n_rt_s: float = 0.0
    lost: float = 0.0
    cut_share: float = 1.0

    def apply(self, session: Session, seed: int) -> tuple[NDArray[np.bool_], FloatArray]:
        """Return a mask of the samples that arrive, and the tension of all samples [N]."""
        random = np.random.default_rng(seed)
        own_n = default_catalogue().rig().load_cell.noise_n
        count = len(session.tension_n)
        step_n = self.drift_n_rt_s * np.sqrt(session.period_ns / 1e9)
        tension_n = session.tension_n + np.cumsum(step_n * random.standard_normal(count))
        added_n = np.sqrt(max(0.0, self.noise_n**2 - own_n**2))
        tension_n += added_n * random.standard_normal(count)
        top_n = self.cut_share * session.tension_n.max()
        kept = random.random(count) >= self.lost
        return kept, tension_n if self.cut_share == 1.0 else np.minimum(tension_n, top_n)


@lru_cache
def simulate_session(
    protocol: str, contact: str, session: int, trials: int, **motion: float
) -> Session:
    """Simulate consecutive trials on every plate or object.

    Parameters
    ----------
    trials : int
        Number of trials on each plate or object.
    **motion : float
        Fields of `TrialConfig` that differ from the defaults.
    """
    catalogue = default_catalogue()
    config = TrialConfig(**motion)  # type: ignore[arg-type]
    planned = plan_trial(config, TrialRequest(protocol, contact), catalogue)
    period_ns = round(1e9 / planned.rate_hz)
    readings: list[FloatArray] = []
    stated: list[StatedTrial] = []
    for label in catalogue.labels(protocol):
        done = simulate_trials(
            protocol, label, contact, planned.timeline, trials, SEED, session=session
        )
        for reading, truth_n in zip(done.tension_n, done.truth['tension_n'], strict=True):
            start_ns = len(readings) * planned.sample_count * period_ns
            stated_ns = {
                phase: start_ns + round(at_s * 1e9)
                for phase, at_s in planned.phases
                if phase != 'approach'
            }
            taut = np.flatnonzero(truth_n[: planned.sample_count] > truth_n[0] + TAUT_N)
            stated_ns['contact'] = start_ns + int(taut[0]) * period_ns
            stated_ns['done'] = start_ns + int(taut[-1]) * period_ns
            readings.append(reading[: planned.sample_count])
            end_ns = start_ns + planned.sample_count * period_ns
            stated.append(StatedTrial(label, start_ns, end_ns, stated_ns))
    return Session(protocol, contact, period_ns, np.concatenate(readings), tuple(stated))


def as_blocks(
    kept: NDArray[np.bool_], tension_n: FloatArray, period_ns: int, size: int = 60
) -> list[StrainBlock]:
    """Divide a stream into blocks of at most ``size`` samples; a lost sample ends a block."""
    blocks = []
    for first in range(0, len(kept), size):
        some = np.flatnonzero(kept[first : first + size]) + first
        for run in np.split(some, np.flatnonzero(np.diff(some) > 1) + 1):
            if len(run):
                at = int(run[0])
                blocks.append(StrainBlock(at * period_ns, at, period_ns, tension_n[run]))
    return blocks
