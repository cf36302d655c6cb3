# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""`tactile simulate`: bags of simulated trials."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from joblib import Parallel, delayed

from tactile_bringup.commands.output import Output
from tactile_bringup.records import TrialConfig
from tactile_bringup.simulated_bags import (
    SimulationPlan,
    paper_plans,
    write_simulated_bag,
)
from tactile_features.records import FeatureConfig
from tactile_sim.description import list_objects


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
    """Write the plans' bags on all cores, with progress."""
    config, features = TrialConfig(simulated=True), FeatureConfig()
    work = (delayed(write_simulated_bag)(folder, plan, config, features) for plan in plans)
    bags = []
    with output.progress() as progress:
        bar = progress.add_task('simulating trials', total=len(plans))
        for bag in Parallel(n_jobs=-1, return_as='generator')(work):
            bags.append(bag)
            progress.advance(bar)
    return bags
