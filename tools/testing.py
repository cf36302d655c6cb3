# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`./tactile test`: the rules of the house, then the tests of every package."""

from __future__ import annotations

import argparse
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
import os
from pathlib import Path
import signal
import subprocess
import time
from typing import Any
import xml.etree.ElementTree as ElementTree

from workspace import ROOT, Workspace

COMPUTING = ('unit', 'analysis')
"""Folders of tests that compute. All others wait for devices and nodes, in real time."""

STEP_BACK = ['sh', '-c', 'echo 19 > /proc/self/autogroup; exec nice -n 19 "$@"', 'sh']
"""Before a command that takes what the others leave of the processor.

Linux shares the processor among sessions first (autogroups), then among a session's processes, and
a simulated rig has a session of its own.
"""


@dataclass
class Outcome:
    """What one package's tests, or one rule, came to."""

    name: str
    passed: int = 0
    failed: int = 0
    skipped: int = 0
    seconds: float = 0.0
    remarks: list[str] = field(default_factory=list)


def run_tests(workspace: Workspace, arguments: list[str]) -> int:
    """Run rules and tests, print a summary, return the exit code; see ``USAGE``."""
    packages = sorted(p.parent.name for p in (ROOT / 'src').glob('*/package.xml'))
    parser = argparse.ArgumentParser(
        'tactile test',
        description='Run the rules of the house and the tests of all packages; of some packages '
        'or some tests, the tests alone.',
    )
    parser.add_argument('packages', nargs='*', metavar='PACKAGE', help=', '.join(packages))
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument('--unit', action='store_true', help='fast tests without ROS or devices')
    kinds.add_argument('--nodes', action='store_true', help='only tests that touch ROS')
    parser.add_argument('-k', dest='expression', metavar='EXPRESSION', help="as pytest's")
    parser.add_argument(
        '--workers',
        type=int,
        default=os.cpu_count() or 1,
        metavar='N',
        help='processes for tests that wait for devices and nodes, and as many for those that '
        'compute (default: one a core)',
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
    computing = [folder for folder in folders if folder.name in COMPUTING]
    waiting = [folder for folder in folders if folder.name not in COMPUTING]
    # A simulated rig that waits for the processor is a failed trial: what computes steps back.
    with Background() as background:
        rules = background.submit(check_rules, workspace, background) if is_all else None
        computed = background.submit(
            run_pytest, workspace, 'computing', computing, options, background if waiting else None
        )
        outcomes = run_pytest(workspace, 'waiting', waiting, options)
        if waiting and not computed.done():
            print('The tests that compute still run ...', flush=True)
        outcomes += computed.result()
        return summarise((rules.result() if rules else []) + merge(outcomes))


class Background(ThreadPoolExecutor):
    """Threads whose commands take what others leave of the processor, and end with Ctrl-C."""

    def __init__(self) -> None:
        super().__init__(2)
        self._running: list[subprocess.Popen[str]] = []

    def run(self, command: list[str], workspace: Workspace) -> subprocess.CompletedProcess[str]:
        """Run a command to its end; return its code and all that it said."""
        process = subprocess.Popen(
            [*STEP_BACK, *command],
            cwd=ROOT,
            env=workspace.environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self._running.append(process)
        output, _ = process.communicate()
        return subprocess.CompletedProcess(command, process.returncode, output)

    def __exit__(self, *error: Any) -> None:
        if error[0] is not None:
            self.shutdown(wait=False, cancel_futures=True)
            for process in self._running:
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGTERM)
        super().__exit__(*error)


def site_command(workspace: Workspace) -> list[str]:
    """Return the command that builds the documentation; any warning makes it fail."""
    options = ['-q', '-W', '--keep-going', '-E', '-c', 'docs', '-b', 'html']
    return ['python', '-m', 'sphinx', *options, '.', str(workspace.site)]


def build_site(workspace: Workspace) -> int:
    """Build the documentation, say where it is, return the exit code."""
    command, environment = site_command(workspace), workspace.environment()
    code = subprocess.run(command, cwd=ROOT, env=environment).returncode
    if not code:
        print(f'Open {workspace.site / "docs" / "index.html"}')
    return code


def check_rules(workspace: Workspace, background: Background) -> list[Outcome]:
    """Run the linters and type checks; each is one check that passes or fails."""
    cores = [
        str(p.parent / p.parent.name)
        for p in sorted((ROOT / 'src').glob('*/package.xml'))
        if (p.parent / 'setup.py').exists()
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
    outcomes = []
    for name, command in rules.items():
        started = time.monotonic()
        done = background.run(command, workspace)
        outcome = Outcome(name, seconds=time.monotonic() - started)
        outcomes.append(outcome)
        if done.returncode:
            outcome.failed = 1
            print(f'{name} failed\n{done.stdout}', flush=True)
        else:
            outcome.passed = 1
    return outcomes


def run_pytest(
    workspace: Workspace,
    name: str,
    folders: list[Path],
    options: argparse.Namespace,
    background: Background | None = None,
) -> list[Outcome]:
    """Run the tests in some folders in several processes; return an outcome a package."""
    if not folders:
        return []
    results = workspace.base / f'test_results_{name}.xml'
    results.unlink(missing_ok=True)
    command = ['python', '-m', 'pytest', '-q', '-c', 'pyproject.toml', '--rootdir=.']
    command += ['--disable-warnings', '--tb=long', '--no-summary', f'--junit-xml={results}']
    command += ['-n', str(options.workers), '--dist=worksteal']
    command += ['-k', options.expression] if options.expression else []
    command += map(str, folders)
    if background:
        done = background.run(command, workspace)
    else:
        done = subprocess.run(command, cwd=ROOT, env=workspace.environment(), text=True)
    outcomes = read_results(results) if results.exists() else []
    # 5: no test is called as the expression says.
    if done.returncode not in (0, 5) and not any(o.failed for o in outcomes):
        text = f'FAILED pytest of the tests that are {name}\n{done.stdout or "see above"}'
        outcomes.append(Outcome('pytest', failed=1, remarks=[text]))
    return outcomes


def read_results(path: Path) -> list[Outcome]:
    """Sum up a JUnit file by package."""
    outcomes: dict[str, Outcome] = {}
    skips: Counter[tuple[str, str]] = Counter()
    for case in ElementTree.parse(path).iter('testcase'):
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
            reason = (skip.get('message') or skip.text or '').strip().splitlines()
            skips[f'skipped {place}', ' '.join(reason[-1:])] += 1
        else:
            outcome.passed += 1
    for (place, reason), count in skips.items():
        remark = f'{place} ({count}): {reason}'
        outcomes[place.removeprefix('skipped ').partition('.')[0]].remarks.append(remark)
    return list(outcomes.values())


def merge(outcomes: list[Outcome]) -> list[Outcome]:
    """Return one outcome a package."""
    merged: dict[str, Outcome] = {}
    for outcome in outcomes:
        whole = merged.setdefault(outcome.name, Outcome(outcome.name))
        for name in ('passed', 'failed', 'skipped', 'seconds', 'remarks'):
            setattr(whole, name, getattr(whole, name) + getattr(outcome, name))
    return [merged[name] for name in sorted(merged)]


def summarise(outcomes: list[Outcome]) -> int:
    """Print failures, skips and a table; return 0 only when nothing failed."""
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
