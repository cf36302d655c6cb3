# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings from the simulated rig, made without waiting in real time.

The bags hold the messages that a live recording holds: strain blocks and trial
events. All of them are marked as simulated.

Trials are simulated and turned into bytes by `simulate_chunk`, a plain function of plain
arguments with a small result, which joblib may run wherever it likes. No back-end is named
here, so another one takes over by configuration, a cluster for instance:

    with joblib.parallel_config(backend='dask'):
        write_simulated_bag(folder, plan, TrialConfig(), FeatureConfig(), jobs=-1)

Its workers need the same workspace; one bag is written by the calling process alone. The
bytes of a bag do not depend on how many workers there are, nor where.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
import shutil

from joblib import delayed, Parallel

from tactile_bags.bag_writer import BagWriter
from tactile_bags.message_types import message_store
from tactile_bringup.trial_protocols import PROTOCOLS, TrialConfig
from tactile_classifier.records import CONTACTS
from tactile_features.config import FeatureConfig
from tactile_lab.simulation.simulated_trials import (
    plan_trial,
    PlannedTrial,
    simulate_chunk,
    SimulatedTrial,
    SimulationPlan,
    TrialChunk,
)
from tactile_ros.topics import EVENT, EVENT_TOPIC, STRAIN, STRAIN_TOPIC
from tactile_sim.descriptions.catalogue import Catalogue

CHUNK_TRIALS = 256
"""Most trials that a worker simulates at a time."""

ROUND_TRIALS = 8192
"""About how many finished trials may wait to be written: 10 kB each. A round has at least one
chunk of each label."""


@dataclass(frozen=True)
class SimulatedBag:
    """Bag that was written, with the number of its trials.

    ``trials``: number of trials in the bag, including aborted ones. ``aborted``: trials that the
    simulator aborted: id and time since the first sample [s].
    """

    path: Path
    trials: int
    aborted: tuple[tuple[str, float], ...]


def count_trials(plan: SimulationPlan, catalogue: Catalogue) -> int:
    """Return how many trials a plan has in all its sessions."""
    return plan.sessions * plan.trials_per_label * len(catalogue.labels(plan.protocol))


def write_simulated_bag(
    folder: Path,
    plan: SimulationPlan,
    trial_config: TrialConfig,
    feature_config: FeatureConfig,
    *,
    catalogue: Catalogue | None = None,
    jobs: int | None = 1,
    on_trials: Callable[[int], None] = lambda count: None,
) -> SimulatedBag:
    """Simulate a plan's trials and write them as one bag below ``folder``.

    The trials come session after session; within a session the first trial of each label,
    then the second of each, and so on. A bag that cannot be finished is removed.

    ``catalogue``: descriptions of finger, rig, plates and objects; those of the package when left
    out. ``jobs``: as joblib takes it: -1 is all cores. ``on_trials``: called with the number of
    trials that have been written since the last call.

    Raises `BagError` when the bag exists already or cannot be written. Raises `TactileSimError`
    when a description does not fit.
    """
    catalogue = catalogue or Catalogue(None)
    trial_config = plan.configure(trial_config)
    planned = plan_trial(trial_config, plan.request, catalogue)
    metadata = {
        'simulated': True,
        'seed': plan.seed,
        'protocol': plan.protocol,
        'contact': plan.contact,
        'trials_per_label': plan.trials_per_label,
        'sessions': plan.sessions,
        'trials_per_mounting': plan.trials_per_mounting,
        'description_sha256': catalogue.digest,
        'feature_config': asdict(feature_config),
        'trial_config': asdict(trial_config),
    }
    aborted: list[tuple[str, float]] = []
    written = 0
    with BagWriter(folder / plan.name, metadata) as writer:
        topics = {STRAIN: writer.add_topic(STRAIN_TOPIC), EVENT: writer.add_topic(EVENT_TOPIC)}
        missing = 0
        try:
            for trial in _simulate(plan, planned, trial_config, catalogue, jobs):
                for stamp_ns, type_name, data in trial.messages:
                    if missing and type_name == STRAIN:
                        data = _state_loss(data, missing)
                        missing = 0
                    writer.write_raw(topics[type_name], stamp_ns, data)
                missing += trial.missing_samples
                if trial.failed_at_s is not None:
                    aborted.append((trial.trial_id, trial.failed_at_s))
                written += 1
                on_trials(1)
        except BaseException:
            writer.close()
            shutil.rmtree(writer.path)
            raise
    return SimulatedBag(folder / plan.name, written, tuple(aborted))


def _simulate(
    plan: SimulationPlan,
    planned: PlannedTrial,
    config: TrialConfig,
    catalogue: Catalogue,
    jobs: int | None,
) -> Iterator[SimulatedTrial]:
    """Yield a plan's trials in the order of the bag, round after round."""
    labels = catalogue.labels(plan.protocol)
    groups = _chunk_groups(plan, labels)
    largest = min(plan.trials_per_label, CHUNK_TRIALS) * len(labels)
    # In rounds, since joblib would go on simulating while the writer lags behind.
    with Parallel(n_jobs=jobs, return_as='generator') as parallel:
        while taken := list(islice(groups, max(1, ROUND_TRIALS // largest))):
            done = parallel(
                delayed(simulate_chunk)(plan, planned, config, catalogue, chunk)
                for group in taken
                for chunk in group
            )
            side_by_side: list[list[SimulatedTrial]] = []
            for trials in done:
                side_by_side.append(trials)
                if len(side_by_side) == len(labels):
                    for of_one_number in zip(*side_by_side, strict=True):
                        yield from of_one_number
                    side_by_side.clear()


def _chunk_groups(plan: SimulationPlan, labels: Sequence[str]) -> Iterator[list[TrialChunk]]:
    """Yield the chunks of all labels with the same sessions and numbers."""
    for session in range(plan.sessions):
        for first in range(0, plan.trials_per_label, CHUNK_TRIALS):
            count = min(CHUNK_TRIALS, plan.trials_per_label - first)
            row = (session * plan.trials_per_label + first) * len(labels)
            yield [
                TrialChunk(label, session, first, count, row + i, len(labels))
                for i, label in enumerate(labels)
            ]


def _state_loss(data: bytes, lost_before: int) -> bytes:
    """Return a strain block that says how many samples before it are missing."""
    block = message_store().deserialize_cdr(data, STRAIN)
    block.lost_before = lost_before  # type: ignore[attr-defined]
    return bytes(message_store().serialize_cdr(block, STRAIN))


def paper_plans(trials: int, sessions: int, seed: int) -> Sequence[SimulationPlan]:
    """Return the paper's four sets: texture and stiffness, flexion and abduction.

    ``trials``: on each plate or object in each session.
    """
    return [
        SimulationPlan(protocol, contact, trials, seed, sessions)
        for protocol in PROTOCOLS
        for contact in CONTACTS
    ]
