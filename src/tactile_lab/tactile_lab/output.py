# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Output of the commands: tables and progress for people, JSON for programs.

With ``--json``, standard output contains a single JSON document, and everything else is printed to
standard error. Progress is always printed to standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
import json
from pathlib import Path
from typing import Any, TYPE_CHECKING

from tactile_lab.console import PlainConsole, Table
from tactile_ros.errors import named_errors, TactileError

if TYPE_CHECKING:
    import pyarrow

    from tactile_bags.audit import Audit


TABLES = ('.parquet', '.csv')
PICTURES = ('.png', '.svg', '.pdf')
"""Suffixes of the figures that commands write; `TABLES` are those of tables."""


class Output:
    """Output of one command; ``as_json`` is True if the result is to be printed as JSON."""

    def __init__(self, as_json: bool) -> None:
        self.as_json = as_json
        self._err = PlainConsole(stderr=True)
        self._out = self._err if as_json else PlainConsole()

    def say(self, *texts: str | Table, markup: bool = False) -> None:
        """Print lines or tables for people; if ``markup`` is True, lines contain rich markup."""
        for text in texts:
            if isinstance(text, Table):
                self._out.say_table(text)
            else:
                self._out.say(text, markup=markup)

    def say_audits(self, audits: Iterable[Audit]) -> None:
        """Print the findings of the audits, and a line about each audit of a whole bag."""
        for audit in audits:
            if not audit.passed:
                self.say(f'audit: {audit.format()}')
            elif not audit.trial_id:
                self.say(f'audit: {audit.format()}, {audit.rate_hz:.4g} Hz')

    def result(self, document: dict[str, Any]) -> None:
        """Print the result as JSON, if ``as_json`` is True."""
        if self.as_json:
            print(json.dumps(document, indent=1, allow_nan=False))  # noqa: T201

    @contextmanager
    def progress(self, title: str) -> Iterator[Callable[..., None]]:
        """Show a progress bar while the block runs; provide a function that updates it.

        There is no bar if standard error is not a terminal.
        """
        if not self._err.file.isatty():
            yield lambda *_: None
            return
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
        )

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
    """Raise `TactileError` if one of the files exists, unless ``force`` is True."""
    if not force and (there := [str(path) for path in paths if path.exists()]):
        raise TactileError(
            f'{", ".join(there)} already exists; give another name, or --force to replace it'
        )


def make_output_folder(folder: Path) -> None:
    """Create the folder for the results of a command.

    It is created before the computation, so that an error is reported early.
    """
    with named_errors('make the folder', folder):
        folder.mkdir(parents=True, exist_ok=True)


def refuse_suffix(option: str, path: Path, suffixes: Sequence[str]) -> None:
    """Raise `TactileError` if the file name of an option does not end in one of these suffixes."""
    if path.suffix.lower() not in suffixes:
        *some, last = suffixes
        ends = f'{", ".join(some)} or {last}' if some else last
        raise TactileError(f'{option} is {path}; it must end in {ends}')


def write_table(table: pyarrow.Table, path: Path) -> None:
    """Write a table as Parquet or CSV, depending on the suffix of the path."""
    import pyarrow.csv
    import pyarrow.parquet

    with named_errors('write', path):
        if path.suffix.lower() == '.csv':
            pyarrow.csv.write_csv(table, path)
        else:
            pyarrow.parquet.write_table(table, path, compression='zstd')
