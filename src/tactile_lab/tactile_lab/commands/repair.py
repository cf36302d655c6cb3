# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile repair`: a closed copy of a bag whose recorder was killed."""

from __future__ import annotations

from pathlib import Path

from tactile_bags.auditing.audit import summarise_audits
from tactile_bags.auditing.auditor import audit_bag
from tactile_bags.bag_repair import repair_bag
from tactile_lab.commands.output import Output
from tactile_lab.commands.replay import print_audits


def run_repair(source: Path, target: Path, *, as_json: bool) -> bool:
    """Repair a bag, print what came of it, return whether all of it could be read."""
    output = Output(as_json)
    repair = repair_bag(source, target)
    if not repair.recovered:
        output.say(f'{source} was closed in order; a copy was made all the same')
    if repair.damage:
        output.say(f'{repair.damage}; the copy ends there')
    audits = audit_bag(target)
    output.say(f'{target}: {repair.message_count} messages')
    print_audits(audits, output)
    output.result({'bag': str(target), **repair.to_dict(), 'audit': summarise_audits(audits)})
    return not repair.damage
