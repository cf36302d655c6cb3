# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Check that `pip install .` works without ROS in an empty environment.

``python tools/wheel.py`` builds the wheel with the current Python, installs it with pip into a new
virtual environment, and tries the commands and the examples. Then it runs the tests that do not
need ROS (tools/test_cores.sh) with the newest version of each library.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

ROOT = Path(__file__).resolve().parent.parent

MODULES = """
import sys
import tactile_analysis, tactile_bags, tactile_classifier
import tactile_features, tactile_lab, tactile_sim
from tactile_bags.bag_reader import TactileBag
from tactile_classifier import load_model
from tactile_analysis import read_tables
from pathlib import Path

bag, model = Path(sys.argv[1]), load_model(sys.argv[2])
with TactileBag(bag) as opened:
    assert len(list(opened.messages())) > 100
table = read_tables([bag])['texture', 'flexion']
answers = model.predict(table.values)
assert len(answers) == len(table) and set(answers) <= {'unknown', *model.labels}
for module in ('rclpy', 'ament_index_python', 'tactile_msgs'):
    assert module not in sys.modules, module
"""


def main() -> int:
    started = time.monotonic()
    with tempfile.TemporaryDirectory(prefix='tactile_wheel_') as scratch:
        folder = Path(scratch)
        run([sys.executable, '-m', 'venv', folder / 'venv'], folder)
        python = folder / 'venv' / 'bin' / 'python'
        pip = [python, '-m', 'pip', '--quiet', '--disable-pip-version-check']
        run([*pip, 'wheel', '--no-deps', '--wheel-dir', folder, ROOT], folder)
        (wheel,) = folder.glob('tendon_tactile-*.whl')
        # The version is fixed, because other versions of Hypothesis generate other examples.
        run([*pip, 'install', wheel, 'hypothesis==6.151.5', 'pytest'], folder)
        print(f'installed after {time.monotonic() - started:.0f} s', flush=True)
        print(run([*pip, 'list'], folder), flush=True)
        use(python, folder)
        print(run(['sh', ROOT / 'tools' / 'test_cores.sh', python], folder), flush=True)
    version = sys.version.split()[0]
    print(f'{wheel.name} works on Python {version}, {time.monotonic() - started:.0f} s')
    return 0


def use(python: Path, folder: Path) -> None:
    """Use the installed commands, modules and examples; raise SystemExit if a result is wrong."""
    tactile = python.with_name('tactile')
    bag, model = folder / 'bags' / 'texture_flexion', folder / 'models' / 'texture_flexion.npz'
    run([tactile, '--version'], folder)
    run([tactile, '--help'], folder)
    simulate = [tactile, 'simulate', 'texture', '--output', bag.parent, '--contact', 'flexion']
    run([*simulate, '--trials', '6', '--sessions', '2', '--jobs', '1', '--json'], folder)
    run([tactile, 'train', bag, '--output', model.parent, '--classifier', 'knn', '--json'], folder)
    told = run([tactile, 'evaluate', bag, '--repetitions', '1', '--json'], folder)
    if json.loads(told)['sets'][0]['trials'] != 96:
        raise SystemExit('evaluate did not report the 96 simulated trials')
    run([tactile, 'classify', bag, '--model', model, '--json'], folder)
    run([python, '-c', MODULES, bag, model], folder)
    for arguments in (['sense', '--simulated'], ['demo'], ['rig', '--simulated']):
        run([tactile, *arguments], folder, code=2, says='source a ROS 2 workspace')
    for example in sorted((ROOT / 'docs' / 'examples').glob('*.py')):
        run([python, example], folder)


def run(command: list[str | Path], folder: Path, *, code: int = 0, says: str = '') -> str:
    """Run a program outside of this clone and without ROS 2; return its output.

    Raises SystemExit if the exit code is not ``code``, or if standard error does not contain the
    text ``says``.
    """
    foreign = ('AMENT_', 'COLCON_', 'PYTHON', 'ROS_', 'VIRTUAL_ENV')
    environment = {k: v for k, v in os.environ.items() if not k.startswith(foreign)}
    done = subprocess.run(
        [str(part) for part in command],
        cwd=folder,
        env={**environment, 'MPLBACKEND': 'Agg'},
        capture_output=True,
        text=True,
    )
    if done.returncode != code or says not in done.stderr:
        print(done.stdout, done.stderr, sep='\n', file=sys.stderr)
        line = ' '.join(str(part) for part in command)
        raise SystemExit(f'exit code {done.returncode}, not {code}, or output missing: {line}')
    return done.stdout


if __name__ == '__main__':
    sys.exit(main())
