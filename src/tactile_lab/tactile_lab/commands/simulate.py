# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile simulate`: write bags of simulated trials."""

from collections.abc import Sequence
from pathlib import Path
import time
from typing import Annotated, Optional, TYPE_CHECKING

import typer

from tactile_lab import options
from tactile_lab.output import make_output_folder, Output
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_lab.simulation.simulated_bags import SimulatedBag
    from tactile_lab.simulation.simulated_trials import SimulationPlan
    from tactile_sim.descriptions.catalogue import Catalogue

CROSSED = 'crossed'
AS_PUBLISHED = 'as-published'
SESSIONS = 6
"""Number of sessions of the design `CROSSED`. The threshold for unknown objects needs several
sessions."""

ALL_TRIALS = 60
"""Number of trials on each plate in the paper (section III.A)."""


def simulate(
    protocol: Annotated[
        str,
        typer.Argument(**options.choice('texture', 'stiffness'), help='Kind of trial.'),
    ],
    folder: Annotated[Path, typer.Option('--output', '-o', help='Folder for the bags.')],
    contact: Annotated[
        Optional[list[str]],
        typer.Option(
            **options.choice('flexion', 'abduction'),
            help='Contact of the finger; give it twice for both. Default: both.',
        ),
    ] = None,
    trials: Annotated[
        Optional[int],
        typer.Option(
            min=1,
            max=100_000,
            help='Trials on each plate or object in each session. Default: 60 over all sessions.',
        ),
    ] = None,
    sessions: Annotated[
        Optional[int],
        typer.Option(
            min=1,
            max=1000,
            help='Number of sessions. Trials of one session share the set-up of finger and rig, '
            'and the temperature. With several sessions, a model can distinguish unknown objects '
            'from new sessions. Default: 6; for as-published 1.',
        ),
    ] = None,
    design: Annotated[
        str,
        typer.Option(
            **options.choice(CROSSED, AS_PUBLISHED),
            help='crossed: the plate or object is mounted again before each trial. as-published: '
            'as in the paper, it is mounted once for all of its trials, in one session, so that '
            'label and mounting coincide.',
        ),
    ] = CROSSED,
    speed: Annotated[
        Optional[list[float]],
        typer.Option(
            min=1,
            max=200,
            help='Sliding speed over the plate in mm/s. May be repeated; one bag per speed is '
            'written. Default: 15.',
        ),
    ] = None,
    seed: options.SeedOption = 1,
    description: options.DescriptionOption = None,
    jobs: options.JobsOption = -1,
    as_json: options.JsonOption = False,
) -> None:
    """Make bags of **simulated** trials, without waiting in real time.

    Writes one bag for each contact. A bag contains the given number of trials on each plate or
    object in each session. The messages are the same as in live recordings, but marked as
    simulated. With the same version of NumPy, the same seed gives the same bytes, for any number
    of processes.

    If the simulator finds no equilibrium in a trial, the trial ends as aborted at that time, and
    has no features. The exit code is then 3.
    """
    if jobs == 0:
        raise TactileError('--jobs is 0; give a number of processes, or -1 for all cores')
    if speed and protocol != 'texture':
        raise TactileError('--speed is only for texture trials; stiffness trials do not glide')
    is_published = design == AS_PUBLISHED
    if is_published and sessions not in (None, 1):
        raise TactileError(
            f'--sessions is {sessions}, but --design {AS_PUBLISHED} has one session, because '
            f'the paper describes no sessions; omit --sessions, or use --design {CROSSED}'
        )
    sessions = sessions or (1 if is_published else SESSIONS)
    trials = trials or max(1, ALL_TRIALS // sessions)

    from tactile_lab.simulation.simulated_bags import count_trials
    from tactile_lab.simulation.simulated_trials import SimulationPlan
    from tactile_sim.descriptions.catalogue import Catalogue

    output = Output(as_json)
    catalogue = Catalogue(description)
    contacts = tuple(dict.fromkeys(contact or ('flexion', 'abduction')))
    speeds_m_s = [mm_s / 1e3 for mm_s in dict.fromkeys(speed or ())]
    per_mounting = trials if is_published else 1
    plans = [
        SimulationPlan(protocol, one, trials, seed, sessions, speed_m_s, per_mounting)
        for one in contacts
        for speed_m_s in speeds_m_s or (None,)
    ]
    total = sum(count_trials(plan, catalogue) for plan in plans)
    output.say(
        f'SIMULATED {protocol} trials, {" and ".join(contacts)}: {total} in all; '
        f'{len(plans)} x {sessions} x {trials} (bags, sessions, trials) on each of '
        f'{", ".join(catalogue.labels(protocol))}; design {design}'
    )
    started = time.monotonic()
    bags = make_bags(folder, plans, output, catalogue=catalogue, jobs=jobs)
    elapsed_s = time.monotonic() - started
    output.say(*(f'{bag.path}: {bag.trials} simulated trials' for bag in bags))
    output.say(f'{total} trials in {elapsed_s:.1f} s: {total / elapsed_s:.0f} per second')
    described = [
        {
            'path': str(bag.path),
            'protocol': plan.protocol,
            'contact': plan.contact,
            'glide_speed_m_s': plan.glide_speed_m_s,
            'design': design,
            'trials_per_mounting': plan.trials_per_mounting,
            'sessions': plan.sessions,
            'trials_per_label_and_session': plan.trials_per_label,
            'trials': bag.trials,
            'aborted': dict(bag.aborted),
            'seed': plan.seed,
        }
        for bag, plan in zip(bags, plans, strict=True)
    ]
    output.result({'simulated': True, 'bags': described})
    raise typer.Exit(3 if any(bag.aborted for bag in bags) else 0)


def make_bags(
    folder: Path,
    plans: 'Sequence[SimulationPlan]',
    output: Output,
    *,
    catalogue: 'Catalogue | None' = None,
    jobs: int = -1,
) -> 'list[SimulatedBag]':
    """Write a bag for each plan, with a progress bar; print the aborted trials.

    Raises `BagError` before the simulation when one of the bags exists already.
    """
    from tactile_bags.errors import BagError
    from tactile_bringup.trial_protocols import TrialConfig
    from tactile_features.config import FeatureConfig
    from tactile_lab.simulation.simulated_bags import count_trials, write_simulated_bag
    from tactile_sim.descriptions.catalogue import Catalogue

    make_output_folder(folder)
    for plan in plans:
        if (folder / plan.name).exists():
            raise BagError(f'{folder / plan.name} exists already; name another folder')
    catalogue = catalogue or Catalogue(None)
    config, features = TrialConfig(), FeatureConfig()
    started, done = time.monotonic(), 0
    total = sum(count_trials(plan, catalogue) for plan in plans)
    with output.progress('simulating trials') as show:

        def advance(count: int) -> None:
            nonlocal done
            done += count
            rate = done / max(time.monotonic() - started, 1e-3)
            show(done, total, f'simulating trials, {rate:.0f} per second')

        bags = [
            write_simulated_bag(
                folder, plan, config, features, catalogue=catalogue, jobs=jobs, on_trials=advance
            )
            for plan in plans
        ]
    for bag in bags:
        if bag.aborted:
            output.say(
                f'{bag.path}: {len(bag.aborted)} of {bag.trials} trials ABORTED, because the '
                'simulator found no equilibrium; they have no features'
            )
        output.say(*(f'   {trial_id} at {at_s:.3f} s' for trial_id, at_s in bag.aborted[:5]))
        if len(bag.aborted) > 5:
            output.say(f'   and {len(bag.aborted) - 5} more; --json lists all of them')
    return bags
