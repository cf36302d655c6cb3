# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags of simulated trials, computed faster than real time.

The bags contain the same messages as a live recording: strain blocks and trial events. All
messages are marked as simulated.

joblib runs `simulate_chunk` in workers, which simulates some trials and converts them to bytes.
Its arguments are small and can be pickled. Only the calling process writes the bag. The bytes of a
bag do not depend on the number of workers.
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
from tactile_classifier.types import CONTACTS
from tactile_features.config import FeatureConfig
from tactile_lab.simulation.simulated_trials import (
    plan_trial,
    simulate_chunk,
    SimulatedTrial,
    SimulationPlan,
    TrialChunk,
    TrialSchedule,
)
from tactile_ros.topics import EVENT, EVENT_TOPIC, STRAIN, STRAIN_TOPIC
from tactile_sim.descriptions.catalogue import Catalogue

CHUNK_TRIALS = 256
"""Largest number of trials that a worker simulates at a time."""

ROUND_TRIALS = 8192
"""Approximate number of trials that are simulated before they are written (10 kB each). At least
one chunk of each label is simulated at a time."""


@dataclass(frozen=True)
class SimulatedBag:
    """A bag that was written.

    ``trials`` is the number of trials in the bag, including aborted trials. ``aborted`` has for
    each aborted trial its id, and the time since its first sample at which it was aborted [s].
    """

    path: Path
    trials: int
    aborted: tuple[tuple[str, float], ...]


def count_trials(plan: SimulationPlan, catalogue: Catalogue) -> int:
    """Return the number of trials in all sessions of a plan."""
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
    """Simulate a plan's trials and write them to one bag in ``folder``.

    The trials are ordered by session. Within a session, the first trials of all labels come first,
    then the second trials, and so on. A bag that cannot be finished is removed.

    Parameters
    ----------
    catalogue : Catalogue, optional
        Descriptions of finger, rig, plates and objects; by default the packaged ones.
    jobs : int
        Number of processes as in joblib; -1 for all cores.
    on_trials : callable
        Called with the number of trials that have been written since the last call.

    Raises
    ------
    BagError
        When the bag exists or cannot be written.
    TactileSimError
        When a description is invalid.
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
    planned: TrialSchedule,
    config: TrialConfig,
    catalogue: Catalogue,
    jobs: int | None,
) -> Iterator[SimulatedTrial]:
    """Simulate the trials of a plan; yield them in the order of the bag."""
    labels = catalogue.labels(plan.protocol)
    groups = _chunk_groups(plan, labels)
    largest = min(plan.trials_per_label, CHUNK_TRIALS) * len(labels)
    # Limit the work in progress: joblib would otherwise simulate much faster than the bag is
    # written.
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
    """Yield lists of chunks. A list has one chunk for each label, with the same trial numbers."""
    for session in range(plan.sessions):
        for first in range(0, plan.trials_per_label, CHUNK_TRIALS):
            count = min(CHUNK_TRIALS, plan.trials_per_label - first)
            row = (session * plan.trials_per_label + first) * len(labels)
            yield [
                TrialChunk(label, session, first, count, row + i, len(labels))
                for i, label in enumerate(labels)
            ]


def _state_loss(data: bytes, lost_before: int) -> bytes:
    """Return a serialized strain block in which ``lost_before`` is set."""
    block = message_store().deserialize_cdr(data, STRAIN)
    block.lost_before = lost_before  # type: ignore[attr-defined]
    return bytes(message_store().serialize_cdr(block, STRAIN))


def paper_plans(trials: int, sessions: int, seed: int) -> Sequence[SimulationPlan]:
    """Return plans for the four sets of trials in the paper.

    These are texture and stiffness, each in flexion and abduction.

    ``trials`` is the number of trials on each plate or object in each session.
    """
    return [
        SimulationPlan(protocol, contact, trials, seed, sessions)
        for protocol in PROTOCOLS
        for contact in CONTACTS
    ]
