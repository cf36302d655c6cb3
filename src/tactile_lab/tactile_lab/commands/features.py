# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Which features a command computes, as its options say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import grouped_split, Split, stratified_split
from tactile_classifier.errors import EvaluationError
from tactile_classifier.training.feature_choice import Candidate, choose_candidate, FeatureChoice
from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.feature_sets.registry import CHOOSER, find_feature_set, list_feature_sets
from tactile_features.feature_sets.texture_spatial import SpatialWindow
from tactile_features.records import PHASE_GLIDE, PHASE_HOLD, SET_TEXTURE_SPATIAL
from tactile_lab.commands.output import Output
from tactile_lab.datasets.bag_tables import read_tables
from tactile_lab.datasets.tables import CLASSIFIER_TITLES, short_scaling
from tactile_ros.errors import TactileError


def choose_features(
    over: str | None, detrend: str | None, features: str | None = None
) -> dict[str, Any]:
    """Return the fields of `FeatureConfig` that ``--over``, ``--detrend`` and ``--features`` say.

    Raises
    ------
    TactileError
        When they do not go together, or ``--over`` is no window.
    """
    if detrend is not None and over is not None:
        raise TactileError('--detrend is for the spectrum over time: leave --over or it out')
    fields = parse_over(over) if detrend is None else {'spectrum_detrend': detrend}
    for name in list_sets(features):
        found = find_feature_set(name)
        assert found is not None
        if over is not None and found.phase == PHASE_GLIDE and not found.needs_speed:
            raise TactileError(f'--over is for sets over the surface, and {name} is none')
        fields[CHOOSER[found.phase]] = name
    return fields


def list_sets(features: str | None) -> list[str]:
    """Return the sets of features that ``--features`` names; none when it names features."""
    names = [name.strip() for name in (features or '').split(',')]
    return names if all(map(find_feature_set, names)) else []


def parse_over(text: str | None) -> dict[str, Any]:
    """Return the fields of `FeatureConfig` that ``LENGTH:FINEST`` in millimetres says.

    None says nothing.

    Raises
    ------
    TactileError
        When it is not of that form, or the window is too short for its finest scale.
    """
    if text is None:
        return {}
    length, _, finest = text.partition(':')
    try:
        window = SpatialWindow(float(length) / 1e3, float(finest) / 1e3)
        fields: dict[str, Any] = {
            'texture_features': SET_TEXTURE_SPATIAL,
            'spatial_length_m': window.length_m,
            'spatial_finest_m': window.finest_m,
        }
        FeatureConfig(**fields)
    except FeatureError as error:
        raise TactileError(f'--over: {error}') from error
    except ValueError as error:
        raise TactileError(f'--over: "{text}" is not LENGTH:FINEST in mm, as in 45:0.5') from error
    return fields


AUTO = 'auto'
"""In place of a set of features: choose one inside the folds."""

Key = tuple[str, str]


def choose_automatically(
    bags: Sequence[Path], chosen: Mapping[str, Any], folds: int, random_state: int, output: Output
) -> dict[Key, tuple[FeatureTable, Candidate]]:
    """Choose set of features and classifier for each task and contact of bags, and say why.

    Models of one task share a feature node, so the contacts of a task share a set: that whose best
    classifiers have the highest mean accuracy.

    Parameters
    ----------
    bags : sequence of Path
    chosen : mapping
        Fields of `FeatureConfig`, such as the window over the surface.
    folds, random_state : int
        Of random folds, where there is one session only.
    output : Output

    Returns
    -------
    dict
        By task and contact: the table of the chosen set, and what was chosen.
    """
    tables = _read_all(bags, chosen, output)
    choices = {
        key: choose_candidate(found, _divide(found, folds, random_state), random_state)
        for key, found in tables.items()
    }
    picked = {}
    for (task, contact), choice in choices.items():
        same = [other for key, other in choices.items() if key[0] == task]
        shared = [n for n in tables[task, contact] if all(map(_holds(n), same))]
        name = max(shared, key=lambda n: sum(_best(each, n).accuracy for each in same))
        best = _best(choice, name)
        output.say(f'{task}, {contact}: {describe_choice(choice, name)}')
        picked[task, contact] = tables[task, contact][name], best.candidate
    return picked


def describe_choice(choice: FeatureChoice, name: str) -> str:
    """Return what was chosen, and what the runner-up would have cost."""
    best = _best(choice, name)
    picks = sum(count for candidate, count in choice.picks if candidate[0] == name)
    folds = sum(count for _, count in choice.picks)
    text = (
        f'{_name(best.candidate)}, {100 * best.accuracy:.1f} % ({choice.split}); {picks} of '
        f'{folds} folds choose this set, too; chosen inside the folds '
        f'{100 * choice.nested_accuracy:.1f} %'
    )
    others = [score for score in choice.ranking if score.candidate[0] != name]
    if not others:
        return text
    other = others[0]
    points = 100 * (other.accuracy - best.accuracy)
    return (
        f'{text}; the runner-up is {_name(other.candidate)}: {points:+.1f} points, and '
        f'{other.fold_s / best.fold_s:.2g} times the time of training and tests'
    )


def _name(candidate: Candidate) -> str:
    title = CLASSIFIER_TITLES[candidate.classifier]
    return f'{candidate.feature_set} with {title}, {short_scaling(candidate.scaling)}'


def _best(choice: FeatureChoice, name: str) -> Any:
    return next(score for score in choice.ranking if score.candidate[0] == name)


def _holds(name: str) -> Any:
    return lambda choice: any(score.candidate[0] == name for score in choice.ranking)


def _divide(tables: Mapping[str, FeatureTable], folds: int, random_state: int) -> Split:
    table = next(iter(tables.values()))
    try:
        return grouped_split(table, ['session_id'])
    except EvaluationError:  # one session only
        return stratified_split(table, folds, 1, random_state)


def _read_all(
    bags: Sequence[Path], chosen: Mapping[str, Any], output: Output
) -> dict[Key, dict[str, FeatureTable]]:
    """Return the tables of all sets that give features of the same trials."""
    tables: dict[Key, dict[str, FeatureTable]] = {}
    sets = (list_feature_sets(PHASE_GLIDE), list_feature_sets(PHASE_HOLD))
    for glide, hold in zip_longest(*sets):
        fields = {
            'texture_features': glide or sets[0][0],
            'stiffness_features': hold or sets[1][0],
        }
        found = read_tables(bags, {**chosen, **fields})
        for key, table in found.tables.items():
            others = tables.setdefault(key, {})
            first = next(iter(others.values()), table)
            if np.array_equal(table.column('trial_id'), first.column('trial_id')):
                others.setdefault(table.spec.feature_set, table)
            else:
                output.say(
                    f'{table.spec.feature_set} is left out: it gives features of {len(table)} '
                    f'trials, {first.spec.feature_set} of {len(first)}; {found.left_out[:1]}'
                )
    return tables
