# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Output of the commands: tables and progress for people, JSON for machines.

With ``--json`` standard output carries one JSON document and nothing else. Progress always goes
to standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
import json
import os
from pathlib import Path
from typing import Any, TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_bags.audit import Audit


class Output:
    """The terminal of one command.

    Parameters
    ----------
    as_json : bool
        Whether the result is wanted as JSON.
    """

    def __init__(self, as_json: bool) -> None:
        self.as_json = as_json
        self._err = Console(stderr=True)
        self._out = self._err if as_json else Console()

    def say(self, text: Any = '', *, plain: bool = False) -> None:
        """Print a line or a table for people; ``plain``: square brackets are no markup."""
        self._out.print(text, highlight=False, soft_wrap=isinstance(text, str), markup=not plain)

    def say_audits(self, audits: Iterable[Audit]) -> None:
        """Print what is missing, doubled or out of order; one line where nothing is."""
        for audit in audits:
            if not audit.passed:
                self.say(f'audit: {audit.format()}')
            elif not audit.trial_id:
                self.say(f'audit: {audit.format()}, {audit.rate_hz:.4g} Hz')

    def result(self, document: dict[str, Any]) -> None:
        """Print the result's JSON, when it is wanted."""
        if self.as_json:
            print(json.dumps(document, indent=1, allow_nan=False))  # noqa: T201

    @contextmanager
    def progress(self, title: str) -> Iterator[Callable[..., None]]:
        """Show a bar while the block runs; give what sets how much of how much is done."""
        bar = Progress(
            TextColumn('{task.description}'),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=self._err,
            transient=True,
        )
        with bar:
            task = bar.add_task(title, total=None)

            def show(done: int, total: int, description: str = title) -> None:
                bar.update(task, completed=done, total=total, description=description)

            yield show


def refuse_to_replace(paths: Iterable[Path], *, force: bool) -> None:
    """Refuse to write over files that exist, unless it is wanted.

    Raises
    ------
    TactileError
        When one of them exists.
    """
    if force:
        return
    if there := [str(path) for path in paths if path.exists()]:
        raise TactileError(f'{", ".join(there)} would be replaced: give another name, or --force')


def make_output_folder(folder: Path) -> None:
    """Make a folder for results, before the work that fills it.

    Raises
    ------
    TactileError
        When it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TactileError(f'cannot make the folder {folder}: {error.strerror}') from error


def write_atomically(path: Path, text: str) -> None:
    """Replace a file at once, and have it on the disk: there is never half of one."""
    temporary = path.with_name(f'.{path.name}.new')
    with temporary.open('w', encoding='utf-8') as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
