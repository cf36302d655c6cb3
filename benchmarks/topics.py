# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""All that `python -m benchmarks` can measure."""

from __future__ import annotations

from collections.abc import Callable
import importlib
from typing import NamedTuple

from benchmarks.measuring import Report

LONG = True


class Topic(NamedTuple):
    """One thing to measure.

    Attributes
    ----------
    name : str
        As in ``--only``.
    module : str
        Has the function ``run_<name>``, which takes whether to be quick. A module is imported when
        its topic runs: some need what others do not.
    summary : str
    is_long : bool
        Takes many minutes, or needs peers installed. It runs when it is named.
    """

    name: str
    module: str
    summary: str
    is_long: bool = False

    def run(self, quick: bool) -> Report:
        """Measure."""
        module = importlib.import_module(f'benchmarks.{self.module}')
        measure: Callable[[bool], Report] = getattr(module, 'run_' + self.name.replace('-', '_'))
        return measure(quick)


TOPICS = (
    Topic('spectrum', 'kernels.features', '91 amplitudes of a texture window'),
    Topic('regression', 'kernels.features', 'slope, intercept, correlation of a stiffness window'),
    Topic(
        'significance',
        'kernels.significance',
        'rank-sum tests of all pairs of classes, all features',
    ),
    Topic('extractor', 'kernels.features', 'sample blocks and events to windows'),
    Topic(
        'sensors', 'nodes.sensors', 'sensor nodes, 60 Hz to five times 7 kHz: cost, loss, latency'
    ),
    Topic('net-ft', 'nodes.net_ft', 'a Net F/T from datagrams to blocks, beside pynetft'),
    Topic('inference', 'kernels.inference', 'one window through a model file, four classifiers'),
    Topic('simulator', 'simulator.schemes', 'texture trials: speed and error by scheme and step'),
    Topic(
        'paths', 'simulator.paths', 'readings, the NumPy solver, stiffness trials, the live rig'
    ),
    Topic(
        'aliasing', 'simulator.paths', 'what sampling and the place of the plate do to amplitudes'
    ),
    Topic('hard-cases', 'simulator.hard_cases', 'extreme descriptions, far too long steps'),
    Topic('twin', 'simulator.twin', 'error beside the same scene in MuJoCo (needs mujoco)', LONG),
    Topic('twin-speed', 'simulator.twin', 'speed beside the same scene in MuJoCo', LONG),
    Topic(
        'published',
        'accuracy.published',
        'the paper: as-published trials, one setting at a time',
        LONG,
    ),
    Topic('hard-plates', 'accuracy.twelve_plates', 'twelve plates, pitches 5 % apart', LONG),
    Topic('messages', 'nodes.message_path', 'latency from publish to the features node'),
    Topic('hand', 'nodes.hand', 'five fingers, from a block to a classification', LONG),
    Topic('endurance', 'nodes.hand', 'is anything lost in ten minutes of five times 7 kHz', LONG),
    Topic(
        'long-recording',
        'nodes.long_recording',
        'a week: memory, opening, repair (15 GB of disk)',
        LONG,
    ),
    Topic(
        'pitch', 'events.pitch_and_press', 'pitch of grooves: error, coverage of its uncertainty'
    ),
    Topic(
        'press',
        'events.pitch_and_press',
        'stiffness and relaxation: error, coverage of its uncertainty',
    ),
    Topic('slip', 'events.slip', 'slip detector: misses, latency, false alarms'),
    Topic('rolling', 'events.rolling', 'what a rolling object does to the tension', LONG),
    Topic('slip-limits', 'events.slip_limits', 'how much of a slip a matched filter sees', LONG),
    Topic('rest', 'nodes.rest', 'from a killed process or a cut cable to rest', LONG),
    Topic('signals', 'nodes.signals', 'hangs and exit codes of 2,000 SIGINTs and SIGTERMs', LONG),
    Topic('speeds', 'accuracy.speeds', 'texture at a speed never seen, on recordings', LONG),
    Topic('simulated-speeds', 'accuracy.speeds', 'texture at a speed never seen, simulated', LONG),
    Topic(
        'peers', 'accuracy.peers', 'MiniRocket (aeon), tsfresh, raw neighbours beside ours', LONG
    ),
    Topic(
        'training-cost',
        'accuracy.random_convolutions',
        'random convolutions beside MiniRocket (aeon): time',
        LONG,
    ),
    Topic(
        'public-sets',
        'accuracy.random_convolutions',
        'and accuracy, on recordings that come with aeon',
        LONG,
    ),
    Topic('phases', 'events.phases', 'phases found in the tension: how often, how exactly'),
    Topic('phase-rest', 'events.phases', 'false phases of a finger at rest'),
    Topic('phase-features', 'events.phases', 'accuracy with found phases, beside stated ones'),
    Topic('phase-holds', 'events.phases', 'phases found in real holds'),
    Topic('phase-cost', 'events.phases', 'cost of finding phases'),
)
