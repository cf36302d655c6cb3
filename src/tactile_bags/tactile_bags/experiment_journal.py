# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exclusions and corrected labels of trials, from the journal of an experiment.

The journal has one JSON entry per line; `tactile_lab.experiment` writes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

from tactile_bags.errors import BagError

PLAN, ORDER, JOURNAL, BAGS = 'plan.yaml', 'order.csv', 'journal.jsonl', 'bags'
"""Names of files and folders in the folder of an experiment."""


@dataclass(frozen=True)
class Correction:
    """Entries of the journal about a trial.

    ``why_not`` is the reason why the trial is excluded, or None. ``label`` is its corrected label,
    and ``specimen`` is the name of the plate or object under the finger. Both are empty if the
    journal does not state them.
    """

    why_not: str | None = None
    label: str = ''
    specimen: str = ''


def is_experiment(path: Path) -> bool:
    """Return True if a path is the folder of an experiment."""
    return (path / PLAN).is_file() and (path / ORDER).is_file()


def experiment_of(bag: Path) -> Path | None:
    """Return the folder of the experiment that contains a bag, or None."""
    bag = bag.resolve()
    if bag.parent.name != BAGS or not (bag.parent.parent / JOURNAL).is_file():
        return None
    return bag.parent.parent


def read_corrections(folder: Path) -> dict[str, Correction]:
    """Return the corrections in the journal of an experiment, by trial id.

    Raises `BagError` when the journal cannot be read or has an invalid entry.
    """
    path = folder / JOURNAL
    try:
        return _add_up(parse_journal(path.read_bytes())[0])
    except OSError as error:
        raise BagError(f'cannot read the journal {path}: {error.strerror}') from error
    except BagError as error:
        raise BagError(f'the journal {path}: {error}') from error
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BagError(f'the journal {path} is damaged: {error!r}; restore it from a copy') from (
            error
        )


def parse_journal(data: bytes) -> tuple[list[dict[str, Any]], int]:
    """Return the entries of a journal, and the length of the valid part [byte].

    Text after the last complete line is an interrupted entry and is ignored. A power cut can also
    leave zeros at the end, so damaged lines at the end are ignored, too. If a damaged line comes
    before a valid one, raises `BagError`.
    """
    entries: list[dict[str, Any]] = []
    length = position = damaged = 0
    for number, line in enumerate(data.split(b'\n')[:-1], start=1):
        position += len(line) + 1
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError):
            entry = None
        if not isinstance(entry, dict) or not isinstance(entry.get('kind'), str):
            damaged = damaged or number
        elif damaged:
            raise BagError(f'line {damaged} is damaged; restore it from a copy')
        else:
            entries.append(entry)
            length = position
    return entries, length


def _add_up(entries: Iterable[Mapping[str, Any]]) -> dict[str, Correction]:
    verdicts: dict[str, str] = {}
    kept: set[str] = set()
    excluded: dict[str, str] = {}
    labels: dict[str, str] = {}
    specimen_on: dict[str, str] = {}
    specimens: dict[str, str] = {}
    for entry in entries:
        kind, trial_id = entry['kind'], str(entry.get('trial_id', ''))
        if kind == 'mounted':
            specimen_on[str(entry['mounting_id'])] = str(entry.get('specimen', ''))
        elif kind == 'began':
            verdicts[trial_id] = ''
            specimens[trial_id] = specimen_on.get(str(entry.get('mounting_id', '')), '')
        elif kind == 'ended':
            verdicts[trial_id] = str(entry['verdict'])
            if entry['verdict'] == 'good':
                kept.add(trial_id)
        elif kind == 'kept':
            kept.add(trial_id)
        elif kind == 'excluded':
            excluded[trial_id] = str(entry['why'])
        elif kind == 'included':
            excluded.pop(trial_id, None)
        elif kind == 'relabelled':
            labels[trial_id] = str(entry['label'])
            if specimens.get(trial_id):  # the specimen of the new label is unknown
                specimens[trial_id] = labels[trial_id]
    found = {}
    for trial_id, verdict in verdicts.items():
        why_not = None
        if trial_id in excluded:
            why_not = f'excluded: {excluded[trial_id]}'
        elif trial_id not in kept:
            why_not = f'repeated ({verdict or "interrupted"})'
        found[trial_id] = Correction(
            why_not, labels.get(trial_id, ''), specimens.get(trial_id, '')
        )
    return found
