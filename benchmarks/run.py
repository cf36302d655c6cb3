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

"""Speed against error of what this workspace computes. See docs/benchmarks.md."""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import json
import sys
import time
from typing import Any

from measuring import Report
from rich.console import Console
from rich.table import Table

TOPICS = {
    'spectrum': ('features', 'run_spectrum'),
    'regression': ('features', 'run_regression'),
    'significance': ('significance', 'run_significance'),
    'extractor': ('features', 'run_extractor'),
    'sensors': ('sensors', 'run_node'),
    'net_ft': ('net_ft', 'run_net_ft'),
    'inference': ('inference', 'run_inference'),
    'simulator': ('simulator', 'run_simulator'),
    'paths': ('simulator_paths', 'run_paths'),
    'aliasing': ('simulator_paths', 'run_aliasing'),
    'hard-cases': ('simulator_hard_cases', 'run_hard_cases'),
    'twin': ('simulator_twin', 'run_twin'),
    'twin-speed': ('simulator_twin', 'run_twin_speed'),
    'published': ('published', 'run_published'),
    'hard-plates': ('hard_benchmark', 'run_hard_plates'),
    'messages': ('message_path', 'run_messages'),
    'hand': ('hand', 'run_hand'),
    'endurance': ('hand', 'run_endurance'),
    'long_recording': ('long_recording', 'run_long_recording'),
    'pitch': ('measures', 'run_pitch'),
    'press': ('measures', 'run_press'),
    'slip': ('slip', 'run_slip'),
    'rolling': ('rolling', 'run_rolling'),
    'slip-limits': ('slip_limits', 'run_slip_limits'),
    'rest': ('rest', 'run_rest'),
    'signals': ('signals', 'run_signals'),
    'speeds': ('speeds', 'run_speeds'),
    'simulated-speeds': ('speeds', 'run_simulated_speeds'),
    'peers': ('peers', 'run_peers'),
    'training-cost': ('random_convolutions', 'run_training_cost'),
    'public-sets': ('random_convolutions', 'run_public_sets'),
    'phases': ('phases', 'run_phases'),
    'phase-rest': ('phases', 'run_phase_rest'),
    'phase-features': ('phases', 'run_phase_features'),
    'phase-holds': ('phases', 'run_phase_holds'),
    'phase-cost': ('phases', 'run_phase_cost'),
}

LONG = (
    *('hand', 'endurance', 'long_recording', 'peers', 'speeds', 'simulated-speeds'),
    *('rest', 'rolling', 'signals', 'slip-limits', 'twin', 'twin-speed'),
    *('published', 'hard-plates', 'training-cost', 'public-sets'),
)
"""Topics of many minutes, or with peers to install, which are run when they are named."""

DESCRIPTION = """Measure the speed and the error of the numerical kernels, the
model file, the simulator and the message path.

Speed is a ratio: the time of ours over the time of a floor, measured in turns in
the same run. The floor is the least that could do the work (a bare transform, a
bare loop) or a peer that does the same; each table names it. A ratio of 3 says
that ours takes three times as long. Seconds appear nowhere as a claim: they are
the machine's, not the code's.

Error is measured against a reference of higher precision, or as a count of
answers that differ. Where a bound is stated, exceeding it is a failure.
"""

EPILOG = """topics (hand, endurance, long_recording, peers, speeds, rest, rolling, signals,
slip-limits, twins, published, hard-plates, training-cost and public-sets only when named):
  spectrum     91 amplitudes of a texture window
  regression   slope, intercept, correlation of a stiffness window
  significance rank-sum tests of all pairs of classes, all features
  extractor    sample blocks and events to windows
  sensors      the sensor node at 60 Hz to five times 7 kHz: cost, loss, latency
  net_ft       a Net F/T from datagrams to blocks: pynetft against whole arrays
  inference    one window through a model file, four classifiers
  simulator    simulated texture trials: speed and error by scheme and step
  paths        readings, the NumPy solver, stiffness trials, the live rig
  aliasing     what sampling and the plate's place do to the 91 amplitudes
  hard-cases   extreme descriptions, far too long steps, single precision
  twin         against the same scene in MuJoCo: how far apart (needs mujoco)
  twin-speed   and at which speeds
  published    the paper's statements on as-published trials, one setting at a time
  hard-plates  twelve plates, pitches 5 % apart: where each set of features breaks
  messages     latency from publish to the features node
  hand         five fingers, from a block to a classification, three executors
  endurance    ten minutes of five times 7 kHz in blocks: is anything lost
  long_recording  a week without waiting: memory, opening, repair (15 GB of disk)
  pitch        pitch of simulated grooves: error, and coverage of its uncertainty
  press        stiffness and relaxation of simulated objects: the same
  slip         slip detector on simulated grips: misses, latency, false alarms
  rolling      what a rolling object does to the tension, and a bend of it as its sign
  slip-limits  how much of a slip a matched filter sees, and the slip detector
  rest         from a killed process or a cut cable to rest, on the simulated rig
  signals      2,000 SIGINTs and SIGTERMs at random moments: hangs and exit codes
  speeds       texture at a speed never seen, on recordings (needs the archive)
  simulated-speeds  the same on simulated plates
  peers        MiniRocket (aeon), tsfresh and raw neighbours beside ours
  training-cost  random convolutions beside MiniRocket and MultiRocket (aeon)
  public-sets  the same on other recordings, which come with aeon
  phases       of a trial, found in the tension: how often, how exactly (simulated)
  phase-rest      false ones, of a finger at rest
  phase-features  accuracy with them, beside stated ones (simulated)
  phase-holds     in real holds
  phase-cost      what the search costs

exit status:
  0 when every error is within its bound, 1 otherwise, 2 for a wrong argument.

examples:
  ./tactile run python benchmarks/run.py
  ./tactile run python benchmarks/run.py --only spectrum --only regression
  ./tactile run python benchmarks/run.py --quick --json > benchmarks.json
"""


def main() -> int:
    """Run the topics that the arguments name."""
    arguments = _parse_arguments()
    out = Console() if sys.stdout.isatty() else Console(width=100)
    progress = Console(stderr=True)
    documents = {}
    within = True
    for name in arguments.only or (name for name in TOPICS if name not in LONG):
        module, function = TOPICS[name]
        start_s = time.perf_counter()
        report: Report = getattr(importlib.import_module(module), function)(arguments.quick)
        progress.print(f'{name}: {time.perf_counter() - start_s:.0f} s', style='dim')
        within &= all(row.bound is None or row.error <= row.bound for row in report.rows)
        documents[name] = dataclasses.asdict(report)
        if not arguments.json:
            _print(report, out)
    if arguments.json:
        json.dump(documents, sys.stdout, indent=1, allow_nan=False)
        sys.stdout.write('\n')
    return 0 if within else 1


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='benchmarks/run.py',
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        '--only',
        metavar='NAME',
        action='append',
        choices=TOPICS,
        help='run this topic alone; may be given again for another',
    )
    parser.add_argument(
        '--quick',
        action='store_true',
        help='fewer rounds and smaller inputs: the same errors, rougher ratios',
    )
    parser.add_argument(
        '--json',
        action='store_true',
        help='print one JSON document instead of tables; progress goes to standard error',
    )
    return parser.parse_args()


def _print(report: Report, out: Console) -> None:
    rows = report.rows
    table = Table(title=report.title, title_justify='left', title_style='bold')
    table.add_column('case')
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
    for title, _ in columns:
        table.add_column(title, justify='right')
    for row in rows:
        table.add_row(row.case, *(cell(row) for _, cell in columns))
    out.print(table)
    out.print(f'floor: {report.floor}', highlight=False)
    out.print(f'error: {report.error}\n', highlight=False)


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
