# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`./tactile test`: static checks, then the tests of all packages."""

from __future__ import annotations

import argparse
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
import os
from pathlib import Path
import re
import subprocess
import threading
import time
import xml.etree.ElementTree as ElementTree

from workspace import ROOT, Workspace

COMPUTING = ('unit', 'analysis')


@dataclass
class Outcome:
    """Result of the tests of one package, or of one static check."""

    name: str
    passed: int = 0
    failed: int = 0
    skipped: int = 0
    seconds: float = 0.0
    remarks: list[str] = field(default_factory=list)


@dataclass
class Tested:
    """Result of a run of pytest: JUnit file, exit code, and output (empty if it was printed)."""

    results: Path
    code: int
    output: str


def run_tests(workspace: Workspace, arguments: list[str]) -> int:
    """Run checks and tests, print a summary, and return the exit code; see ``USAGE``."""
    packages = sorted(p.parent.name for p in (ROOT / 'src').glob('*/package.xml'))
    parser = argparse.ArgumentParser(
        'tactile test',
        description='Run static checks and the tests of all packages. With packages or '
        '-k, only run the selected tests.',
    )
    parser.add_argument('packages', nargs='*', metavar='PACKAGE', help=', '.join(packages))
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument('--unit', action='store_true', help='fast tests without ROS or devices')
    kinds.add_argument('--nodes', action='store_true', help='only tests that use ROS')
    parser.add_argument('-k', dest='expression', metavar='EXPRESSION', help="like pytest's -k")
    parser.add_argument(
        '--workers',
        type=int,
        default=os.cpu_count() or 1,
        metavar='N',
        help='processes for tests that wait for devices and nodes (default: one per core); '
        'computing tests run beside them, always with one process per core',
    )
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.packages) - set(packages))
    if unknown:
        parser.error(f'no package {", ".join(unknown)}; there are {", ".join(packages)}')
    kind = 'unit' if options.unit else 'node' if options.nodes else '*'
    is_all = not (options.packages or options.expression) and kind == '*'
    folders = [
        folder
        for package in options.packages or packages
        for folder in sorted((ROOT / 'src' / package / 'test').glob(kind))
        if any(folder.rglob('test_*.py'))
    ]
    return summarise(run_all(workspace, folders, options.expression, options.workers, is_all))


def site_command(workspace: Workspace) -> list[str]:
    """Return the command that builds the documentation, in which warnings count as errors."""
    options = ['-q', '-W', '--keep-going', '-E', '-c', 'docs', '-b', 'html']
    return ['python', '-m', 'sphinx', *options, '.', str(workspace.site)]


def build_site(workspace: Workspace) -> int:
    """Build the documentation, print its location, and return the exit code."""
    command, environment = site_command(workspace), workspace.environment()
    code = subprocess.run(command, cwd=ROOT, env=environment).returncode
    if not code:
        print(f'Open {workspace.site / "docs" / "index.html"}')
    return code


def check_rules(workspace: Workspace, low: list[str]) -> list[Outcome]:
    """Run linters and type checks, and return a result for each.

    ``low`` is put before the commands, such as ``nice -n 10``, to lower their priority.
    """
    cores = [
        str(p.parent / p.parent.name)
        for p in sorted((ROOT / 'src').glob('*/package.xml'))
        if (p.parent / 'setup.py').exists() and p.parent.name != 'tactile_testing'
    ]
    folders = ['src', 'tools', 'benchmarks', 'docs']
    rules = {
        'ruff check': ['ruff', 'check', '--quiet', *folders],
        'copyright': ['ruff', 'check', '--quiet', '--preview', '--select', 'CPY001', *folders],
        'ruff format': ['ruff', 'format', '--quiet', '--check', *folders],
        'mypy --strict': ['mypy', *cores],
        'import contracts': ['lint-imports', '--no-cache'],
        'declarations': ['python', 'tools/declarations.py'],
        'documentation': site_command(workspace),
    }
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(
            pool.map(lambda rule: check_rule(workspace, rule, [*low, *rules[rule]]), rules)
        )


def check_rule(workspace: Workspace, name: str, command: list[str]) -> Outcome:
    """Run a linter or type check, and print its result."""
    command = [c for c in command if c != 'benchmarks' or (ROOT / 'benchmarks').is_dir()]
    started = time.monotonic()
    done = subprocess.run(
        command,
        cwd=ROOT,
        env=workspace.environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    outcome = Outcome(name, seconds=time.monotonic() - started)
    if done.returncode:
        outcome.failed = 1
        print(f'\n{name} failed\n{done.stdout}', flush=True)
    else:
        outcome.passed = 1
    return outcome


def run_all(
    workspace: Workspace,
    folders: list[Path],
    expression: str | None,
    workers: int,
    with_rules: bool,
) -> list[Outcome]:
    """Run tests and static checks; return one result per package and per static check.

    Tests of devices and nodes run in real time, and wait for about half of this time. Meanwhile,
    the static checks and the computing tests run with a low priority. Otherwise, they would slow
    down the simulated rigs of the other tests, which could then fail.
    """
    computing = [folder for folder in folders if folder.name in COMPUTING]
    waiting = [folder for folder in folders if folder.name not in COMPUTING]
    cores = os.cpu_count() or 1
    low = ['nice', '-n', '10'] if waiting else []
    is_interrupted = threading.Event()

    def run_beside() -> tuple[list[Outcome], Tested | None]:
        rules = check_rules(workspace, low) if with_rules else []
        if is_interrupted.is_set():
            return rules, None
        # The output is printed at the end, so that it is not mixed with other output.
        tested = run_pytest(workspace, 'computing', computing, cores, expression, low)
        return rules, tested

    with ThreadPoolExecutor(1) as pool:
        beside = pool.submit(run_beside)
        try:
            first = run_pytest(workspace, 'others', waiting, workers, expression)
        except BaseException:  # Ctrl-C also ends the static checks, but not what follows them
            is_interrupted.set()
            raise
        rules, second = beside.result()
    tested = [each for each in (first, second) if each]
    if second and low:
        print(second.output, flush=True)
    outcomes = read_results([each.results for each in tested if each.results.exists()])
    # Pytest returns exit code 5 if the expression selects no test.
    if any(each.code not in (0, 5) for each in tested) and not any(o.failed for o in outcomes):
        outcomes.append(Outcome('pytest', failed=1, remarks=['FAILED pytest; see above']))
    return rules + outcomes


def run_pytest(
    workspace: Workspace,
    name: str,
    folders: list[Path],
    workers: int,
    expression: str | None,
    low: list[str] | None = None,
) -> Tested | None:
    """Run the tests in some folders in several processes; return None if there are no folders.

    ``low`` is put before the command, such as ``nice -n 10``. If it is given, the output is
    returned and not printed.
    """
    if not folders:
        return None
    results = workspace.base / f'test_results_{name}.xml'
    files = order_files(folders, results)
    results.unlink(missing_ok=True)
    command = ['python', '-m', 'pytest', '-q', '-c', 'pyproject.toml', '--rootdir=.']
    command += ['--disable-warnings', '--tb=long', '--no-summary']
    # All tests of a file run in the same process, so that they can share slow fixtures.
    command += [f'--junit-xml={results}', '-n', str(workers)]
    command += ['--dist=loadfile', '--no-loadscope-reorder']
    command += ['-k', expression] if expression else []
    done = subprocess.run(
        [*(low or []), *command, *map(str, files)],
        cwd=ROOT,
        env=workspace.environment(),
        stdout=subprocess.PIPE if low else None,
        stderr=subprocess.STDOUT if low else None,
        text=True,
        errors='replace',
    )
    return Tested(results, done.returncode, done.stdout or '')


def order_files(folders: list[Path], results: Path) -> list[Path]:
    """Return the test files in some folders, sorted by their duration in the last run.

    The slowest files are first. Otherwise, a slow file could be the last one, and only one of the
    processes would still be busy.
    """
    seconds: Counter[str] = Counter()
    with suppress(FileNotFoundError, ElementTree.ParseError):  # no last run, or it was killed
        for case in ElementTree.parse(results).iter('testcase'):
            # ``classname`` is the name of the module, and then the class if there is one.
            module = re.match(r'.*?\.test_\w+', case.get('classname') or '')
            if module:
                seconds[module[0]] += float(case.get('time', 0))

    def time_of(path: Path) -> float:
        return seconds['.'.join(path.relative_to(ROOT).with_suffix('').parts)]

    files = sorted(path for folder in folders for path in folder.rglob('test_*.py'))
    return sorted(files, key=time_of, reverse=True)


def read_results(paths: list[Path]) -> list[Outcome]:
    """Return the results in some JUnit files, summed by package."""
    outcomes: dict[str, Outcome] = {}
    skips: Counter[tuple[str, str]] = Counter()
    cases = [case for path in paths for case in ElementTree.parse(path).iter('testcase')]
    for case in cases:
        place = (case.get('classname') or case.get('name', '')).removeprefix('src.')
        package = place.partition('.')[0]
        outcome = outcomes.setdefault(package, Outcome(package))
        outcome.seconds += float(case.get('time', 0))
        name = f'{place}::{case.get("name", "")}'
        fault = case.find('failure')
        fault = case.find('error') if fault is None else fault
        skip = case.find('skipped')
        if fault is not None:
            outcome.failed += 1
            outcome.remarks.append(f'FAILED {name}\n{fault.text or fault.get("message")}')
        elif skip is not None:
            outcome.skipped += 1
            reason = (skip.get('message') or '').strip()
            # If a whole file was skipped, only the text of the element contains the reason.
            if reason == 'collection skipped':
                reason = (skip.text or '').rpartition('Skipped: ')[2].rstrip('\'")')
            skips[f'skipped {place}', reason.rpartition('\n')[2]] += 1
        else:
            outcome.passed += 1
    for (place, reason), count in skips.items():
        remark = f'{place} ({count}): {reason}'
        outcomes[place.removeprefix('skipped ').partition('.')[0]].remarks.append(remark)
    return [outcomes[package] for package in sorted(outcomes)]


def summarise(outcomes: list[Outcome]) -> int:
    """Print failures, skipped tests and a table; return 0 if nothing failed."""
    for outcome in outcomes:
        for remark in outcome.remarks:
            print(f'\n{remark}' if remark.startswith('FAILED') else remark)
    print(f'\n{"":24}{"passed":>8}{"failed":>8}{"skipped":>8}{"seconds":>9}')
    for outcome in outcomes:
        print(
            f'{outcome.name:24}{outcome.passed:8}{outcome.failed:8}'
            f'{outcome.skipped:8}{outcome.seconds:9.1f}'
        )
    passed, failed, skipped = (
        sum(getattr(o, name) for o in outcomes) for name in ('passed', 'failed', 'skipped')
    )
    print(f'\n{passed} passed, {failed} failed, {skipped} skipped', flush=True)
    return 1 if failed or not passed else 0
