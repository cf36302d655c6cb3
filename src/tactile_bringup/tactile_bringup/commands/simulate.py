# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""`tactile simulate`: bags of simulated trials."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from joblib import Parallel, delayed

from tactile_bringup.commands.output import Output, make_output_folder
from tactile_bringup.errors import BagError
from tactile_bringup.records import TrialConfig
from tactile_bringup.simulated_bags import (
    SimulationPlan,
    paper_plans,
    simulate_label,
    write_simulated_bag,
)
from tactile_features.records import FeatureConfig
from tactile_sim.description import list_objects
from tactile_sim.fast_trials import SimulatedTrials


def run_simulate(
    protocol: str,
    contacts: Sequence[str],
    trials_per_label: int,
    seed: int,
    folder: Path,
    *,
    as_json: bool,
) -> None:
    """Write one bag for each kind of contact below ``folder``."""
    output = Output(as_json)
    plans = [
        plan
        for plan in paper_plans(trials_per_label, seed)
        if plan.protocol == protocol and plan.contact in contacts
    ]
    bags = make_bags(folder, plans, output)
    trials = trials_per_label * len(list_objects(protocol))
    for bag in bags:
        output.say(f'{bag}: {trials} simulated trials')
    output.result(
        {
            'simulated': True,
            'bags': [
                {
                    'path': str(bag),
                    'protocol': plan.protocol,
                    'contact': plan.contact,
                    'trials': trials,
                    'seed': plan.seed,
                }
                for bag, plan in zip(bags, plans, strict=True)
            ],
        }
    )


def make_bags(folder: Path, plans: Sequence[SimulationPlan], output: Output) -> list[Path]:
    """Write the plans' bags, simulating on all cores, with progress.

    Raises
    ------
    BagError
        When one of the bags exists already: nothing is simulated then.
    """
    make_output_folder(folder)
    for plan in plans:
        if (folder / plan.name).exists():
            raise BagError(f'{folder / plan.name} exists already; name another folder')
    config, features = TrialConfig(simulated=True), FeatureConfig()
    parts = [(plan, label) for plan in plans for label in list_objects(plan.protocol)]
    work = (delayed(simulate_label)(plan, label, config) for plan, label in parts)
    simulated: dict[SimulationPlan, dict[str, SimulatedTrials]] = {plan: {} for plan in plans}
    bags = []
    with output.progress() as progress:
        total = sum(plan.trials_per_label for plan, _ in parts)
        bar = progress.add_task('simulating trials', total=total)
        results = Parallel(n_jobs=-1, return_as='generator')(work)
        for (plan, label), trials in zip(parts, results, strict=True):
            simulated[plan][label] = trials
            progress.advance(bar, plan.trials_per_label)
            if len(simulated[plan]) == len(list_objects(plan.protocol)):
                done = simulated.pop(plan)
                bags.append(write_simulated_bag(folder, plan, config, features, done))
    return bags
