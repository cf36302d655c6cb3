# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials of an experiment that count, and their labels, as its journal says.

The journal is one line of JSON an entry; see `tactile_lab.experiment`, which writes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

from tactile_bags.errors import BagError

PLAN, ORDER, JOURNAL, BAGS = 'plan.yaml', 'order.csv', 'journal.jsonl', 'bags'
"""Names in the folder of an experiment."""


@dataclass(frozen=True)
class Correction:
    """The journal's word on one trial: why it does not count, and its right label; or empty."""

    why_not: str = ''
    label: str = ''


def is_experiment(path: Path) -> bool:
    """Return whether a path is the folder of an experiment."""
    return (path / PLAN).is_file() and (path / ORDER).is_file()


def experiment_of(bag: Path) -> Path | None:
    """Return the folder of the experiment that a bag belongs to; None: it belongs to none."""
    bag = bag.resolve()
    if bag.parent.name != BAGS or not (bag.parent.parent / JOURNAL).is_file():
        return None
    return bag.parent.parent


def read_corrections(folder: Path) -> dict[str, Correction]:
    """Return what the journal of an experiment says of its trials, by trial id.

    A journal that cannot be read, or an entry of another form, is a `BagError`.
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
    """Return the entries, and the length of what holds them [byte].

    What follows the last whole line was cut off and is no entry. A power cut can also leave
    zeros there, so damaged lines at the end are none either; before others they are a `BagError`.
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
    for entry in entries:
        kind, trial_id = entry['kind'], str(entry.get('trial_id', ''))
        if kind == 'began':
            verdicts[trial_id] = ''
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
    found = {}
    for trial_id, verdict in verdicts.items():
        why_not = ''
        if trial_id in excluded:
            why_not = f'excluded: {excluded[trial_id]}'
        elif trial_id not in kept:
            why_not = f'another attempt counts ({verdict or "interrupted"})'
        found[trial_id] = Correction(why_not, labels.get(trial_id, ''))
    return found
