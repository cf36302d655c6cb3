# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Time to set up the workspace of a clone, compared with another revision.

``python -m benchmarks.setup_time REVISION --rounds 3`` clones this repository twice, and runs
``./tactile clean`` and ``./tactile build`` alternately in both clones. A first set-up, which is
not measured, fills the download cache. Processor time is reported in addition to wall time,
because wall time depends on other load.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import resource
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = Path(__file__).resolve().parent.parent


def main() -> None:
    """Measure the current revision and the stated revision, and print the times."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.setup_time', description=__doc__)
    parser.add_argument('revision', help='compare HEAD with this revision')
    parser.add_argument('--rounds', type=int, default=3)
    parser.add_argument('--warm', action='store_true', help='the downloads are in the cache')
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix='tactile_setup_') as scratch:
        clones = {}
        for revision in (arguments.revision, 'HEAD'):
            clone = clones[revision] = Path(scratch) / revision.lower()
            commit = run(ROOT, 'git', 'rev-parse', revision).strip()
            run(ROOT, 'git', 'clone', '--quiet', str(ROOT), str(clone))
            run(clone, 'git', 'checkout', '--quiet', commit)
        if not arguments.warm:
            set_up(clones['HEAD'])
        times: dict[str, list[tuple[float, float]]] = {revision: [] for revision in clones}
        for _ in range(arguments.rounds):
            for revision, clone in clones.items():
                wall_s, cpu_s = set_up(clone)
                times[revision].append((wall_s, cpu_s))
                sys.stdout.write(f'{revision}: {wall_s:.0f} s, processor {cpu_s:.0f} s\n')
                sys.stdout.flush()
    for i, name in enumerate(('wall time', 'processor time')):
        rounds = zip(times[arguments.revision], times['HEAD'], strict=True)
        ratio = statistics.median(new[i] / old[i] for old, new in rounds)
        sys.stdout.write(f'{name}: {ratio:.2f} of {arguments.revision}\n')


def set_up(clone: Path) -> tuple[float, float]:
    """Set up the clone from scratch; return wall and processor time [s]."""
    run(clone, './tactile', 'clean')
    before, started_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    run(clone, './tactile', 'build')
    wall_s = time.monotonic() - started_s
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall_s, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def run(folder: Path, *command: str) -> str:
    """Run a program, which must succeed; return its output."""
    return subprocess.run(
        command, cwd=folder, check=True, stdout=subprocess.PIPE, text=True
    ).stdout


if __name__ == '__main__':
    main()
