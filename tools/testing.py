# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""`./tactile test`: the rules of the house, then the tests of every package."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
import shutil
import subprocess
import time
import xml.etree.ElementTree as ElementTree

from workspace import ROOT, Workspace


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
    """Run rules and tests, print a summary, return the exit code.

    Parameters
    ----------
    workspace : Workspace
    arguments : list of str
        Names of packages; none for all packages and the rules. With ``--nodes``, only what
        touches ROS is run: neither the rules nor the tests of the plain cores.
    """
    nodes_only = '--nodes' in arguments
    named = [argument for argument in arguments if argument != '--nodes']
    packages = sorted(p.parent.name for p in (ROOT / 'src').glob('*/package.xml'))
    unknown = [name for name in named if name not in packages]
    if unknown:
        print(f'tactile: no package {", ".join(unknown)}; there are {", ".join(packages)}')
        return 2
    outcomes = [] if named or nodes_only else check_rules(workspace)
    if nodes_only:
        chosen = [p for p in named or packages if (ROOT / 'src' / p / 'test' / 'node').is_dir()]
        outcomes += test_packages(workspace, chosen, 'test/node')
    else:
        outcomes += test_packages(workspace, named or packages, 'test')
    return summarise(outcomes)


def check_rules(workspace: Workspace) -> list[Outcome]:
    """Run the linters and type checks; each is one check that passes or fails."""
    cores = [
        str(p.parent / p.parent.name)
        for p in sorted((ROOT / 'src').glob('*/package.xml'))
        if (p.parent / 'setup.py').exists()
    ]
    folders = ['src', 'tools', 'benchmarks', 'docs']
    rules = {
        'ruff check': ['ruff', 'check', '--quiet', *folders],
        'ruff format': ['ruff', 'format', '--quiet', '--check', *folders],
        'mypy --strict': ['mypy', *cores],
        'import contracts': ['lint-imports', '--no-cache'],
        'copyright': ['python', 'tools/headers.py'],
        'declarations': ['python', 'tools/declarations.py'],
    }
    outcomes = []
    for name, command in rules.items():
        command = [c for c in command if c != 'benchmarks' or (ROOT / 'benchmarks').is_dir()]
        print(f'{name} ... ', end='', flush=True)
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
            print(f'failed\n{done.stdout}', flush=True)
        else:
            outcome.passed = 1
            print(f'{outcome.seconds:.0f} s', flush=True)
        outcomes.append(outcome)
    return outcomes


def test_packages(workspace: Workspace, packages: list[str], folder: str) -> list[Outcome]:
    """Run `colcon test` on a folder of each package and read the results that it leaves."""
    results = workspace.base / 'test_results'
    shutil.rmtree(results, ignore_errors=True)
    # colcon looks for results where it builds; those of earlier runs must not count.
    for package in packages:
        for old in (workspace.build_base / package).glob('*.xml'):
            old.unlink()
    print(f'tests of {len(packages)} packages (colcon test) ...', flush=True)
    started = time.monotonic()
    done = subprocess.run(
        [
            *(str(workspace.python), '-m', 'colcon', '--log-base', str(workspace.base / 'log')),
            *('test', '--base-paths', str(ROOT / 'src'), '--merge-install'),
            *('--build-base', str(workspace.build_base)),
            *('--install-base', str(workspace.install)),
            *('--test-result-base', str(results)),
            *('--packages-select', *packages, '--return-code-on-test-failure'),
            *('--pytest-args', folder),
            *('--event-handlers', 'console_stderr-', 'summary-'),
        ],
        cwd=ROOT,
        env=workspace.environment(),
        stderr=subprocess.PIPE,
        text=True,
    )
    seconds = time.monotonic() - started
    outcomes = []
    for package in packages:
        if not any((ROOT / 'src' / package / 'test').rglob('test_*.py')):
            continue
        files = sorted((results / package).rglob('*.xml'))
        outcomes.append(read_results(package, files))
    if done.returncode and not any(outcome.passed for outcome in outcomes):
        outcomes.append(
            Outcome('colcon test', failed=1, remarks=[f'FAILED colcon test\n{done.stderr}'])
        )
    print(f'tests took {seconds:.0f} s', flush=True)
    return outcomes


def read_results(package: str, files: list[Path]) -> Outcome:
    """Sum up the JUnit files of one package."""
    outcome = Outcome(package)
    for path in files:
        for suite in ElementTree.parse(path).iter('testsuite'):
            outcome.seconds += float(suite.get('time', 0))
            for case in suite.iter('testcase'):
                name = f'{case.get("classname", "")}::{case.get("name", "")}'
                fault = case.find('failure')
                fault = case.find('error') if fault is None else fault
                skip = case.find('skipped')
                if fault is not None:
                    outcome.failed += 1
                    outcome.remarks.append(f'FAILED {name}\n{fault.text or fault.get("message")}')
                elif skip is not None:
                    outcome.skipped += 1
                    reason = (skip.text or skip.get('message') or '').strip().splitlines()
                    outcome.remarks.append(f'skipped {name}: {" ".join(reason[-1:])}')
                else:
                    outcome.passed += 1
    if not (outcome.passed or outcome.failed or outcome.skipped):
        outcome.failed = 1
        outcome.remarks.append(f'FAILED {package}: its tests left no results')
    return outcome


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
