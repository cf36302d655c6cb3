# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile repair`: write a closed copy of a bag whose recorder was killed."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from tactile_lab import options
from tactile_lab.output import Output


def repair(
    bag: Annotated[Path, typer.Argument(exists=True, help='The bag that was not closed.')],
    target: Annotated[
        Path, typer.Option('--output', '-o', help='Folder of the copy; must not exist.')
    ],
    as_json: options.JsonOption = False,
) -> None:
    """Write a closed copy of a bag whose recorder was killed.

    Our other commands read a bag that was not closed, and print a warning. Other programs may need
    the index that the copy has at its end. The copy contains the same messages, byte for byte, and
    the name of the original bag. The original is not changed. If the bag is damaged, the copy
    contains the readable messages, and the exit code is 1.
    """
    from tactile_bags.audit import audit_bag, summarise_audits
    from tactile_bags.bag_repair import repair_bag
    from tactile_bags.errors import BagError

    output = Output(as_json)
    repaired = repair_bag(bag, target)
    if not repaired.recovered:
        output.say(f'{bag} was closed properly; it was copied anyway')
    if repaired.damage:
        output.say(f'{repaired.damage}; the copy contains the readable messages')
    output.say(f'{target}: {repaired.message_count} messages')
    try:
        audits = audit_bag(target)
    except BagError as error:  # a message that cannot be decoded was copied, too
        if not repaired.damage:
            raise
        audits = []
        output.say(f'not audited: {error}')
    output.say_audits(audits)
    output.result({'bag': str(target), **asdict(repaired), 'audit': summarise_audits(audits)})
    raise typer.Exit(1 if repaired.damage else 0)
