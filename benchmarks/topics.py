# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Topics of `python -m benchmarks`."""

from __future__ import annotations

from collections.abc import Callable
import importlib
from typing import NamedTuple

from benchmarks.measuring import Report

LONG = True


class Topic(NamedTuple):
    """One thing to measure, by the function ``run_<name>`` of a module.

    A module is imported when its topic runs: some need what others do not. A long topic, or one
    that needs peers installed, runs when it is named.
    """

    name: str
    module: str
    summary: str
    is_long: bool = False

    def find(self) -> Callable[[bool], Report]:
        """Import the function that measures."""
        module = importlib.import_module(f'benchmarks.{self.module}')
        measure: Callable[[bool], Report] = getattr(module, 'run_' + self.name.replace('-', '_'))
        return measure


TOPICS = (
    Topic('spectrum', 'kernels.features', '91 amplitudes of a texture window'),
    Topic('regression', 'kernels.features', 'slope, intercept, correlation of a stiffness window'),
    Topic('significance', 'kernels.significance', 'rank-sum tests of all pairs of classes'),
    Topic('inference', 'kernels.inference', 'one window through a model file'),
    Topic('predictions', 'kernels.predictions', 'one window, beside another checkout', LONG),
    Topic('simulator', 'simulator.schemes', 'texture trials: speed and error by step'),
    Topic('rig-cpu', 'simulator.rig_cpu', 'processor time of the simulated rig', LONG),
    Topic('twin', 'simulator.twin', 'error beside the same scene in MuJoCo (needs mujoco)', LONG),
    Topic('twin-speed', 'simulator.twin', 'speed beside the same scene in MuJoCo', LONG),
    Topic('robustness', 'simulator.robustness', 'accuracy by condition of sensor and rig'),
    Topic('paper', 'paper.reproduction', "the paper's protocol beside its numbers", LONG),
    Topic('paper-settings', 'paper.settings', "the paper's statements, by setting", LONG),
    Topic('hard-plates', 'accuracy.twelve_plates', 'twelve plates, pitches 5 % apart', LONG),
    Topic('speeds', 'accuracy.speeds', 'public recordings at a speed never seen', LONG),
    Topic('rate-error', 'accuracy.rate_error', 'a wrong sample rate or guide speed', LONG),
    Topic('choice', 'accuracy.choices', 'features and classifier chosen by the folds', LONG),
    Topic('unlearned', 'accuracy.choices', 'labels that training has not seen', LONG),
    Topic('calibration-error', 'accuracy.choices', 'stated and true error of probabilities', LONG),
    Topic('peers', 'accuracy.peers', 'features of aeon and tsfresh beside ours', LONG),
    Topic('phases', 'events.phases', 'phases found in the tension: how often, how exactly'),
    Topic('phase-features', 'events.phases', 'accuracy with found phases, beside stated ones'),
    Topic('thresholds', 'sessions.thresholds', 'unknown objects in new sessions', LONG),
    Topic('sensors', 'nodes.sensors', 'sensor nodes, 60 Hz to five times 7 kHz: CPU, loss'),
    Topic('hand', 'nodes.hand', 'five fingers, from a block to a classification', LONG),
    Topic('rig-nodes', 'nodes.rig_nodes', 'processor time and memory of an idle rig', LONG),
    Topic('rest', 'nodes.rest', 'from a killed process or a cut cable to rest', LONG),
)
