# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Run benchmarks of speed, error and accuracy; see docs/benchmarks.md."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from typing import Any

from benchmarks.measuring import Report
from benchmarks.topics import TOPICS
from tactile_lab.console import PlainConsole, Table

DESCRIPTION = """Measure speed, error and accuracy. docs/benchmarks.md explains the results.

Speed is a ratio: the time of this code divided by the time of a floor. Both are
measured alternately in the same run. The floor is the minimum work for the task
(a bare transform, a bare loop), or a comparable library; each table names it.

Error is the deviation from a reference of higher precision, or the number of
different predictions. A topic fails if an error exceeds its bound.
"""

EPILOG = """exit status:
  0 if all topics ran and all errors are within their bounds, 1 otherwise,
  2 for a wrong argument.

examples:
  ./tactile run python -m benchmarks
  ./tactile run python -m benchmarks --only spectrum --only regression
  ./tactile run python -m benchmarks --quick --json > benchmarks.json
"""


def main() -> int:
    """Run the benchmarks that the arguments select."""
    arguments = _parse_arguments()
    out, progress = PlainConsole(), PlainConsole(stderr=True)
    documents = {}
    within = True
    for topic in TOPICS:
        if topic.name not in arguments.only if arguments.only else topic.is_long:
            continue
        start_s = time.perf_counter()
        try:
            report = topic.find()(arguments.quick)
        except ModuleNotFoundError as error:
            progress.say(f'{topic.name} needs {error.name}: pip install {error.name}')
            within = False
            continue
        progress.say(f'{topic.name}: {time.perf_counter() - start_s:.0f} s', style='dim')
        within &= all(row.bound is None or row.error <= row.bound for row in report.rows)
        documents[topic.name] = dataclasses.asdict(report)
        if not arguments.json:
            _print(report, out)
    if arguments.json:
        json.dump(documents, sys.stdout, indent=1, allow_nan=False)
        sys.stdout.write('\n')
    return 0 if within else 1


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks',
        description=DESCRIPTION,
        epilog=_list_topics() + EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        '--only',
        metavar='NAME',
        action='append',
        choices=[topic.name for topic in TOPICS],
        help='run only this topic; may be repeated',
    )
    parser.add_argument(
        '--quick',
        action='store_true',
        help='fewer rounds and smaller inputs: the same errors, less precise ratios',
    )
    parser.add_argument(
        '--json',
        action='store_true',
        help='print one JSON document instead of tables; progress is printed to standard error',
    )
    return parser.parse_args()


def _list_topics() -> str:
    width = max(len(topic.name) for topic in TOPICS)
    lines = [
        f'  {topic.name:{width}} {"*" if topic.is_long else " "} {topic.summary}\n'
        for topic in TOPICS
    ]
    return f'topics (* only with --only):\n{"".join(lines)}\n'


def _print(report: Report, out: PlainConsole) -> None:
    rows = report.rows
    columns: list[tuple[str, Any]] = []
    if any(row.ratio for row in rows):
        columns.append(('time / floor', lambda row: _ratio(row.ratio)))
    columns += [
        (key, lambda row, key=key: _number(row.more.get(key)))
        for key in dict.fromkeys(key for row in rows for key in row.more)
    ]
    for title, name in (('error', 'error'), ('bound', 'bound'), ('floor error', 'floor_error')):
        if any(getattr(row, name) is not None for row in rows):
            columns.append((title, lambda row, name=name: _number(getattr(row, name))))
    table = Table('case', *(title for title, _ in columns), title=report.title, right_from=1)
    for row in rows:
        table.add_row(row.case, *(cell(row) for _, cell in columns))
    out.say_table(table)
    for name in ('floor', 'error'):
        if text := getattr(report, name):
            out.say(f'{name}: {text}')
    out.say('')
    for each in report.more:
        _print(each, out)


def _ratio(ratio: Any) -> str:
    if ratio is None:
        return ''
    return f'{_number(ratio.median)} ({_number(ratio.low)} to {_number(ratio.high)})'


def _number(value: Any) -> str:
    if value is None:
        return ''
    if isinstance(value, float):
        return f'{value:.0f}' if 100 <= value < 1e5 else f'{value:.2g}'
    return str(value)


if __name__ == '__main__':
    sys.exit(main())
