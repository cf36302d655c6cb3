# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Agreement of SIMULATED trials with the statements of the paper, if one setting is changed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.measuring import Report, Row
from benchmarks.paper.protocol import (
    CLASSIFIERS,
    CONTACTS,
    cross_validate,
    in_unit,
    make_trials,
    TASKS,
    TRIALS,
)
from benchmarks.paper.statements import measure_alike, STATEMENTS

SEEDS = tuple(range(1, 21))


@dataclass(frozen=True)
class Setting:
    """Settings of simulation and classification.

    The object is mounted again after every ``per_mounting`` trials. ``rig`` is YAML that replaces
    values of the packaged ``rig.yaml``. ``newton`` is the number of units of force per newton, for
    example 1000 for features in millinewtons. For ``gamma`` and ``scaled`` see `cross_validate`.
    """

    name: str
    per_mounting: int = TRIALS
    rig: str = '{}'
    newton: float = 1.0
    gamma: str = 'scale'
    scaled: bool = False
    tasks: tuple[str, ...] = TASKS


def _drive(error_m: float) -> str:
    return f'variation: {{trial: {{tendon_zero_m: {error_m:g}}}}}'


QUIET = 'load_cell: {noise_n: 0.0004}'


BASE = Setting('base: each mounted once, mean removed, N, gamma scale, not scaled')
HOLDS = replace(BASE, tasks=('stiffness',))
SETTINGS = (
    BASE,
    replace(BASE, name='scaled', scaled=True),
    replace(BASE, name='gamma auto, mN', gamma='auto', newton=1e3),
    replace(BASE, name='fixed again for each trial (crossed)', per_mounting=1),
    replace(HOLDS, name='drive repeats to 3.5 um', rig=_drive(3.5e-6)),
    replace(HOLDS, name='drive repeats to 1.75 um', rig=_drive(1.75e-6)),
    replace(HOLDS, name='drive repeats exactly', rig=_drive(0.0)),
    replace(HOLDS, name='sensor noise 0.4 mN (a tenth)', rig=QUIET),
    replace(HOLDS, name='drive 1.75 um, noise 0.4 mN', rig=f'{_drive(1.75e-6)}\n{QUIET}'),
)


def run_paper_settings(quick: bool) -> Report:
    """Change one setting at a time, and count the seeds that agree with each statement."""
    seeds = SEEDS[:1] if quick else SEEDS
    rows = [
        Row(f'{setting.name}; {task}, {contact}', more=_judge(setting, task, contact, seeds))
        for setting in (SETTINGS[:1] if quick else SETTINGS)
        for task in setting.tasks
        for contact in CONTACTS
    ]
    return Report(
        'paper-settings: the statements of the paper on SIMULATED trials',
        '',
        f'accuracy in %, six stratified folds: mean of {len(seeds)} seeds (minimum to maximum), '
        'and number of seeds for which a statement holds',
        rows,
    )


def _judge(setting: Setting, task: str, contact: str, seeds: tuple[int, ...]) -> dict[str, str]:
    accuracies, alike = [], []
    for seed in seeds:
        trials = make_trials(task, contact, seed, setting.per_mounting, setting.rig)
        values = in_unit(task, trials.values, setting.newton)
        found = cross_validate(
            values,
            trials.labels,
            scaled=setting.scaled,
            gamma=setting.gamma,
            repetitions=1,
            seed=seed,
        )
        accuracies.append(found[:, 0])
        alike.append(measure_alike(task, trials))
    by_seed = np.array(accuracies)
    more = {
        name: f'{mean:.1f} ({least:.1f} to {most:.1f})'
        for name, mean, least, most in zip(
            CLASSIFIERS,
            *(100 * of(by_seed, axis=0) for of in (np.mean, np.min, np.max)),
            strict=True,
        )
    }
    holds = {
        each.name: each.agrees(by_seed, np.array(alike))
        for each in STATEMENTS
        if each.task == task
    }
    if task == 'texture':
        more['over 0.05 [%]'] = f'{100 * min(alike):.0f} to {100 * max(alike):.0f}'
    else:
        holds['both'] = holds['others 97.2'] & holds['RBF lower']
    return more | {'holds in': ', '.join(f'{k}: {int(v.sum())}' for k, v in holds.items())}
