# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""List of the benchmarks that `python -m benchmarks` can run. Each of them is called a topic."""

from __future__ import annotations

from collections.abc import Callable
import importlib
from typing import NamedTuple

from benchmarks.measuring import Report

LONG = True


class Topic(NamedTuple):
    """A benchmark, implemented by the function ``run_<name>`` of a module.

    The module is imported when its topic runs, because some topics need additional packages. Long
    topics, and topics that compare with other libraries, only run if they are selected.
    """

    name: str
    module: str
    summary: str
    is_long: bool = False

    def find(self) -> Callable[[bool], Report]:
        """Import and return the function that runs the benchmark."""
        module = importlib.import_module(f'benchmarks.{self.module}')
        measure: Callable[[bool], Report] = getattr(module, 'run_' + self.name.replace('-', '_'))
        return measure


TOPICS = (
    Topic('spectrum', 'kernels.features', '91 amplitudes of a texture window'),
    Topic('regression', 'kernels.features', 'slope, intercept, correlation of a stiffness window'),
    Topic('significance', 'kernels.significance', 'rank-sum tests of all pairs of classes'),
    Topic('inference', 'kernels.inference', 'one window through a model file'),
    Topic('predictions', 'kernels.predictions', 'one window; needs another checkout', LONG),
    Topic('training', 'kernels.training', 'train and evaluate; needs another checkout', LONG),
    Topic('simulator', 'simulator.schemes', 'simulated texture trials: speed and error by step'),
    Topic('rig-cpu', 'simulator.rig_cpu', 'processor time of the simulated rig', LONG),
    Topic(
        'twin', 'simulator.twin', 'deviation from the same scene in MuJoCo (needs mujoco)', LONG
    ),
    Topic('twin-speed', 'simulator.twin', 'speed compared with MuJoCo', LONG),
    Topic('robustness', 'simulator.robustness', 'accuracy by condition of sensor and rig'),
    Topic('paper', 'paper.reproduction', 'results of the paper on simulated trials', LONG),
    Topic('paper-settings', 'paper.settings', 'statements of the paper, by setting', LONG),
    Topic('hard-plates', 'accuracy.twelve_plates', 'twelve plates, pitches 5 % apart', LONG),
    Topic('speeds', 'accuracy.speeds', 'sliding speeds without training trials', LONG),
    Topic('rate-error', 'accuracy.rate_error', 'a wrong sample rate or guide speed', LONG),
    Topic('choice', 'accuracy.choices', 'automatic choice of features and classifier', LONG),
    Topic('unlearned', 'accuracy.choices', 'detection of labels without training trials', LONG),
    Topic('calibration-error', 'accuracy.choices', 'stated and true calibration error', LONG),
    Topic('peers', 'accuracy.peers', 'comparison with features of aeon and tsfresh', LONG),
    Topic('phases', 'events.phases', 'phases detected in the tension: success rate and error'),
    Topic('phase-features', 'events.phases', 'accuracy with detected and commanded phases'),
    Topic('thresholds', 'sessions.thresholds', 'unknown objects in new sessions', LONG),
    Topic('sensors', 'nodes.sensors', 'sensor nodes, 60 Hz to five times 7 kHz: CPU, loss'),
    Topic('hand', 'nodes.hand', 'five fingers: latency from samples to classification', LONG),
    Topic('rig-nodes', 'nodes.rig_nodes', 'processor time and memory of an idle rig', LONG),
    Topic('rest', 'nodes.rest', 'from a killed process or a cut cable to rest', LONG),
)
