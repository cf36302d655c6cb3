# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Models of two files or folders that answer the same question."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tactile_classifier.model_file.inference import TactileModel
from tactile_classifier.names import CLASSIFIER_TITLES, short_scaling
from tactile_features.model_contract import read_contracts
from tactile_ros.errors import TactileError

SIDES = ('A', 'B')


@dataclass(frozen=True)
class Contender:
    """One of the two models."""

    path: Path
    model: TactileModel

    @property
    def title(self) -> str:
        manifest = self.model.manifest
        return f'{CLASSIFIER_TITLES[manifest.classifier]}, {short_scaling(manifest.scaling)}'

    @property
    def size_bytes(self) -> int:
        return self.path.stat().st_size


def load_models(path: Path) -> list[Contender]:
    """Return the models of a file or folder.

    Raises
    ------
    TactileError, ModelFileError
        When there is none, or a file of a folder cannot be used.
    """
    contracts, refused = read_contracts(path)
    if refused:
        raise TactileError('; '.join(refused))
    return [Contender(each.path, TactileModel.load(each.path)) for each in contracts]


def pair_models(
    models_a: list[Contender], models_b: list[Contender]
) -> tuple[list[tuple[Contender, Contender]], list[str]]:
    """Return the models that answer the same question, and a sentence for each other one.

    Raises
    ------
    TactileError
        When there is no pair, or a pair has other labels.
    """
    pairs = [
        (a, b)
        for a in models_a
        for b in models_b
        if a.model.task == b.model.task and len({a.model.contact, b.model.contact} - {''}) < 2
    ]
    if not pairs:
        answers = (
            ', '.join(_question(each.model) for each in models) for models in (models_a, models_b)
        )
        raise TactileError(
            'the models answer different questions, so there is nothing to compare: A answers '
            f'{" and B ".join(answers)}'
        )
    for a, b in pairs:
        sets = [set(each.model.labels) for each in (a, b)]
        only = [', '.join(sorted(mine - other)) for mine, other in (sets, sets[::-1])]
        if any(only):
            raise TactileError(
                f'the models for {_question(a.model)} know different labels: only A knows '
                f'{only[0] or "none"}, only B {only[1] or "none"}. Train both on the same labels'
            )
    paired = [each for pair in pairs for each in pair]
    alone = [
        f'only {side} has a model for {_question(each.model)}: not compared'
        for side, models in zip(SIDES, (models_a, models_b), strict=True)
        for each in models
        if each not in paired
    ]
    return pairs, alone


def question_of(pair: tuple[Contender, Contender]) -> str:
    """Return the task of a pair, and the contact where one is for it alone."""
    return max((_question(each.model) for each in pair), key=len)


def _question(model: TactileModel) -> str:
    return ', '.join(filter(None, (model.task, model.contact)))
