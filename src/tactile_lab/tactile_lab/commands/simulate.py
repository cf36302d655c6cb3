# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile simulate`: bags of simulated trials."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import time

from tactile_bags.errors import BagError
from tactile_bringup.records import TrialConfig
from tactile_features.config import FeatureConfig
from tactile_features.records import PROTOCOL_TEXTURE
from tactile_lab.commands.analysis.requests import SimulateRequest
from tactile_lab.commands.output import make_output_folder, Output
from tactile_lab.simulation.simulated_bags import (
    count_trials,
    SimulatedBag,
    write_simulated_bag,
)
from tactile_lab.simulation.simulated_trials import SimulationPlan
from tactile_ros.errors import TactileError
from tactile_sim.descriptions.catalogue import Catalogue

CROSSED = 'crossed'
AS_PUBLISHED = 'as-published'


def run_simulate(request: SimulateRequest, *, as_json: bool) -> bool:
    """Write one bag for each kind of contact; return whether every trial was computed."""
    output = Output(as_json)
    if request.plot is not None and not request.plot.parent.is_dir():
        raise TactileError(
            f'cannot write {request.plot}: there is no folder {request.plot.parent}; make it, '
            'or name another file'
        )
    if request.jobs == 0:
        raise TactileError('--jobs is 0; it must be a number of processes, or -1 for all cores')
    if request.speeds_m_s and request.protocol != PROTOCOL_TEXTURE:
        raise TactileError('--speed is for texture: nothing else glides over a plate')
    if request.design == AS_PUBLISHED and request.sessions != 1:
        raise TactileError(
            f'--sessions is {request.sessions}, but --design {AS_PUBLISHED} has one session, '
            f'as the paper states none; omit --sessions, or use --design {CROSSED}'
        )
    per_mounting = request.trials_per_label if request.design == AS_PUBLISHED else 1
    catalogue = Catalogue(request.description)
    labels = catalogue.labels(request.protocol)
    plans = [
        SimulationPlan(
            request.protocol,
            contact,
            request.trials_per_label,
            request.seed,
            request.sessions,
            speed_m_s,
            per_mounting,
        )
        for contact in request.contacts
        for speed_m_s in request.speeds_m_s or (None,)
    ]
    total = sum(count_trials(plan, catalogue) for plan in plans)
    output.say(
        f'SIMULATED {request.protocol} trials, {" and ".join(request.contacts)}: {total} in all; '
        f'{len(plans)} x {request.sessions} x {request.trials_per_label} '
        f'(bags, sessions, trials) on each of {", ".join(labels)}; design {request.design}'
    )
    started = time.monotonic()
    bags = make_bags(request.folder, plans, output, catalogue=catalogue, jobs=request.jobs)
    elapsed_s = time.monotonic() - started
    for bag in bags:
        output.say(f'{bag.path}: {bag.trials} simulated trials')
    trials = sum(bag.trials for bag in bags)
    output.say(f'{trials} trials in {elapsed_s:.1f} s: {trials / elapsed_s:.0f} a second')
    if request.plot is not None:
        from tactile_lab.simulation.simulation_plots import plot_simulated_trial

        config = plans[0].configure(TrialConfig(simulated=True))
        plot_simulated_trial(request.plot, plans[0], config, catalogue)
        output.say(f'{request.plot}: one of them as a figure')
    output.result(
        {
            'simulated': True,
            'bags': [
                {
                    'path': str(bag.path),
                    'protocol': plan.protocol,
                    'contact': plan.contact,
                    'glide_speed_m_s': plan.glide_speed_m_s,
                    'design': request.design,
                    'trials_per_mounting': plan.trials_per_mounting,
                    'sessions': plan.sessions,
                    'trials_per_label_and_session': plan.trials_per_label,
                    'trials': bag.trials,
                    'aborted': dict(bag.aborted),
                    'seed': plan.seed,
                }
                for bag, plan in zip(bags, plans, strict=True)
            ],
        }
    )
    return not any(bag.aborted for bag in bags)


def make_bags(
    folder: Path,
    plans: Sequence[SimulationPlan],
    output: Output,
    *,
    catalogue: Catalogue | None = None,
    jobs: int = -1,
) -> list[SimulatedBag]:
    """Write the plans' bags with progress; name the trials that could not be computed.

    Raises
    ------
    BagError
        When one of the bags exists already: nothing is simulated then.
    """
    make_output_folder(folder)
    for plan in plans:
        if (folder / plan.name).exists():
            raise BagError(f'{folder / plan.name} exists already; name another folder')
    catalogue = catalogue or Catalogue(None)
    config, features = TrialConfig(simulated=True), FeatureConfig()
    bags = []
    started = time.monotonic()
    total = sum(count_trials(plan, catalogue) for plan in plans)
    done = 0
    with output.progress('simulating trials') as show:

        def advance(count: int) -> None:
            nonlocal done
            done += count
            rate = done / max(time.monotonic() - started, 1e-3)
            show(done, total, f'simulating trials, {rate:.0f} a second')

        for plan in plans:
            bags.append(  # noqa: PERF401 - each takes minutes
                write_simulated_bag(
                    folder,
                    plan,
                    config,
                    features,
                    catalogue=catalogue,
                    jobs=jobs,
                    on_trials=advance,
                )
            )
    for bag in bags:
        _name_aborted(bag, output)
    return bags


def _name_aborted(bag: SimulatedBag, output: Output) -> None:
    if bag.aborted:
        output.say(
            f'{bag.path}: {len(bag.aborted)} of {bag.trials} trials ABORTED, because the '
            'simulation found no equilibrium; they give no features'
        )
    for trial_id, failed_at_s in bag.aborted[:5]:
        output.say(f'   {trial_id} at {failed_at_s:.3f} s')
    if len(bag.aborted) > 5:
        output.say(f'   and {len(bag.aborted) - 5} more; --json names all of them')
