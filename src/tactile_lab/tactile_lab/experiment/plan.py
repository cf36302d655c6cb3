# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The plan of an experiment, and the random order of its trials."""

from __future__ import annotations

from collections.abc import Mapping
import csv
from dataclasses import astuple, dataclass, fields
import io
import math
from pathlib import Path
import random
import re
from typing import Any

import yaml

from tactile_bringup.trial_protocols import PROTOCOLS
from tactile_classifier.types import CONTACTS
from tactile_ros.errors import TactileError
from tactile_ros.yaml_files import Dumper, load_yaml, read_text

MAX_BYTES = 2**20
"""Largest size of a file with a plan or an order [byte]; enough for about 10,000 trials."""

MAX_TRIALS = 10_000
"""Largest number of trials of an experiment."""

_LABEL = re.compile(r'[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}')


class ExperimentError(TactileError):
    """A plan or the folder of an experiment cannot be used; the message states the reason."""


@dataclass(frozen=True)
class ExperimentPlan:
    """Plan of an experiment: objects, contacts, sessions, mountings and trials.

    Attributes
    ----------
    name : str
        Prefix of the names of sessions.
    objects : tuple of str
        Labels of the plates or objects.
    sessions : int
        Number of sessions; finger and rig are set up again for each session.
    mountings : int
        Number of mountings of each object in each session and contact.
    trials : int
        Trials in each mounting.
    specimens : int
        Number of plates or objects of each label; the mountings of a label alternate between
        them. If there are several, an evaluation can hold out one specimen (``--group specimen``).
    seed : int
        Seed of the random order.
    glide_speed_m_s, hold_s : float
        Sliding speed of texture trials [m/s], and duration of the hold of stiffness trials [s]; 0
        for the parameters of the trial runner.

    Raises
    ------
    ExperimentError
        When a value is invalid.
    """

    name: str
    protocol: str
    objects: tuple[str, ...]
    contacts: tuple[str, ...] = ('flexion',)
    sessions: int = 3
    mountings: int = 2
    trials: int = 5
    specimens: int = 1
    seed: int = 1
    glide_speed_m_s: float = 0.0
    hold_s: float = 0.0

    def __post_init__(self) -> None:
        if self.protocol not in PROTOCOLS:
            raise ExperimentError(
                f'protocol is {_show(self.protocol)}; it must be {" or ".join(PROTOCOLS)}'
            )
        for item, value in (('name', (self.name,)), ('objects', self.objects)):
            for label in value:
                if not isinstance(label, str) or not _LABEL.fullmatch(label):
                    raise ExperimentError(
                        f'{item}: {_show(label)} is not a valid name; use letters, digits, "_", '
                        '".", "+" or "-", and quotes around numbers and words such as "no"'
                    )
        for contact in self.contacts:
            if contact not in CONTACTS:
                raise ExperimentError(
                    f'contacts: {_show(contact)} must be {" or ".join(CONTACTS)}'
                )
        for item, names in (('objects', self.objects), ('contacts', self.contacts)):
            if not names:
                raise ExperimentError(f'{item} is empty; name at least one')
            if len(set(names)) < len(names):
                raise ExperimentError(f'{item}: {", ".join(names)} has a name twice')
        for item in ('sessions', 'mountings', 'trials', 'specimens'):
            _check_count(item, getattr(self, item), 1, MAX_TRIALS)
        _check_count('seed', self.seed, 0, 2**32 - 1)
        for item in ('glide_speed_m_s', 'hold_s'):
            value = getattr(self, item)
            is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not is_number or not 0.0 <= value < 3600.0:
                raise ExperimentError(f'{item} is {_show(value)}; it must be 0 or more')
        if self.trial_count > MAX_TRIALS:
            raise ExperimentError(
                f'the plan has {self.trial_count} trials; the limit is {MAX_TRIALS}'
            )

    @property
    def trial_count(self) -> int:
        """Number of all trials."""
        return (
            self.sessions * len(self.contacts) * self.mountings * len(self.objects) * self.trials
        )

    @property
    def session_ids(self) -> tuple[str, ...]:
        """Names of the sessions."""
        return tuple(f'{self.name}-s{number:02d}' for number in range(1, self.sessions + 1))


@dataclass(frozen=True)
class PlannedTrial:
    """One planned trial.

    Attributes
    ----------
    key : str
        Name of the planned trial, such as ``grooves-s01-m03-t02``.
    mounting : int
        Number of the mounting within the session. Consecutive trials with the same number share
        one mounting.
    trial : int
        Number of the trial within the mounting, from 1.
    specimen : str
        Name of the plate or object, such as ``R1-2``; empty if each label has a single one.
    """

    key: str
    session_id: str
    mounting: int
    trial: int
    contact: str
    object_label: str
    specimen: str = ''


def list_order(plan: ExperimentPlan, session_id: str, first: int = 1) -> list[PlannedTrial]:
    """Return the trials of a session in a random order.

    The order is reproducible: it depends only on plan, session and ``first``. The session consists
    of blocks. A block has one mounting of each object, in random order, so that slow drift of the
    rig affects all objects equally. All blocks of one contact come before those of the other
    contact, because the finger must be turned in between. Which contact comes first is random.
    From block to block, the specimens of a label alternate, also from one session to the next.

    ``first`` is the number of the first mounting. It is not 1 for a block that is appended to a
    session.
    """
    # Python's random module is used, because its results do not change between versions.
    generator = random.Random(f'{plan.seed}/{session_id}/{first}')
    contacts = list(plan.contacts)
    generator.shuffle(contacts)
    order = []
    mounting = first
    earlier = plan.session_ids.index(session_id) * plan.mountings
    earlier += (first - 1) // len(plan.objects)
    for contact in contacts:
        for number in range(plan.mountings):
            block = list(plan.objects)
            generator.shuffle(block)
            specimen = (earlier + number) % plan.specimens + 1
            for label in block:
                order += [
                    PlannedTrial(
                        f'{session_id}-m{mounting:02d}-t{trial:02d}',
                        session_id,
                        mounting,
                        trial,
                        contact,
                        label,
                        f'{label}-{specimen}' if plan.specimens > 1 else '',
                    )
                    for trial in range(1, plan.trials + 1)
                ]
                mounting += 1
    return order


def read_plan(path: Path) -> ExperimentPlan:
    """Read a plan from a YAML file.

    Raises `ExperimentError` when the file cannot be read, or a value is invalid.
    """
    try:
        return parse_plan(load_yaml(read_text(path, MAX_BYTES)), path.stem)
    except TactileError as error:
        raise ExperimentError(f'the plan {path}: {error}') from error


def parse_plan(document: Any, name: str) -> ExperimentPlan:
    """Return the plan in a YAML document; ``name`` is the default for its entry ``name``.

    Raises `ExperimentError` when an entry is missing, unknown or invalid.
    """
    if not isinstance(document, dict):
        raise ExperimentError('it is not a mapping; `tactile experiment new` writes a plan')
    known = [item.name for item in fields(ExperimentPlan)]
    if unknown := [str(key) for key in document if key not in known]:
        raise ExperimentError(f'unknown entry {_show(unknown[0])}; use {", ".join(known)}')
    if missing := [key for key in ('protocol', 'objects') if key not in document]:
        raise ExperimentError(f'{" and ".join(missing)} missing')
    values: dict[str, Any] = {'name': name, **document}
    for key in ('objects', 'contacts'):
        if key in values:
            if not isinstance(values[key], list):
                raise ExperimentError(f'{key} is not a list; write {key}: [R1, C1]')
            values[key] = tuple(values[key])
    return ExperimentPlan(**values)


def format_plan(plan: ExperimentPlan) -> str:
    """Return the plan as YAML, with a comment about each entry."""
    comments: Mapping[str, str] = {
        'name': 'prefix of the names of sessions and trials',
        'protocol': ' or '.join(PROTOCOLS),
        'objects': 'labels of the plates or objects',
        'contacts': ' and '.join(CONTACTS),
        'sessions': 'number of sessions; the rig is set up again for each, best on another day',
        'mountings': 'number of mountings of each object, in each session and contact',
        'trials': 'number of trials in each mounting',
        'specimens': 'number of plates or objects of each label; mountings alternate between them',
        'seed': 'seed of the random order',
        'glide_speed_m_s': 'speed over the plate [m/s]; 0 for the parameter of the trial runner',
        'hold_s': 'duration of the hold [s]; 0 for the parameter of the trial runner',
    }
    lines = ['# Plan of an experiment; run it with: tactile experiment FILE']
    for item, comment in comments.items():
        value = getattr(plan, item)
        value = list(value) if isinstance(value, tuple) else value
        text = yaml.dump([value], Dumper=Dumper, default_flow_style=True, width=math.inf).strip()
        lines.append(f'{item}: {text[1:-1]}'.ljust(40) + f'  # {comment}')
    return '\n'.join(lines) + '\n'


_COLUMNS = tuple(item.name for item in fields(PlannedTrial))


def format_order(order: list[PlannedTrial]) -> str:
    """Return the order as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerows([_COLUMNS, *map(astuple, order)])
    return text.getvalue()


def parse_order(text: str) -> list[PlannedTrial]:
    """Parse the text that `format_order` has written.

    Raises `ExperimentError` when the text is invalid, or contains a trial twice.
    """
    order = []
    rows = csv.reader(io.StringIO(text), strict=True)
    try:
        # Files of earlier versions have no column for the specimen.
        if tuple(next(rows, ())) not in (_COLUMNS, _COLUMNS[:-1]):
            raise ExperimentError(f'its first line must be {",".join(_COLUMNS)}')
        for key, session_id, mounting, trial, contact, label, *specimen in rows:
            if contact not in CONTACTS:
                raise ExperimentError(f'line {rows.line_num}: unknown contact {_show(contact)}')
            order.append(
                PlannedTrial(
                    key, session_id, int(mounting), int(trial), contact, label, *specimen[:1]
                )
            )
    except (ValueError, csv.Error) as error:
        raise ExperimentError(f'line {rows.line_num}: {error}') from error
    if len({trial.key for trial in order}) < len(order):
        raise ExperimentError('a trial occurs twice; undo the change of the file')
    return order


def _check_count(name: str, value: Any, low: int, high: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise ExperimentError(
            f'{name} is {_show(value)}; it must be a whole number from {low} to {high}'
        )


def _show(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + '...'
