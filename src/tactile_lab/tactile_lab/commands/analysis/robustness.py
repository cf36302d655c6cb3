# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile robustness`: how good sensor and rig must be, on simulated trials."""

from __future__ import annotations

from tactile_bringup.records import TrialConfig
from tactile_lab.commands.analysis.requests import RobustnessRequest
from tactile_lab.commands.output import Output
from tactile_lab.report.build import report_path
from tactile_lab.report.figures.robustness import build_robustness_page, tell_axis
from tactile_lab.simulation.robustness import describe, run_study, Study
from tactile_lab.simulation.robustness_axes import list_axes
from tactile_sim.descriptions.catalogue import Catalogue


def run_robustness(request: RobustnessRequest, *, as_json: bool) -> None:
    """Run the study, print a line an axis, write the report."""
    output = Output(as_json)
    file = report_path(request.report)
    study = Study(contact=request.contact, seed=request.seed)
    catalogue = Catalogue(request.description)
    with output.progress('simulating conditions') as show:
        points = run_study(study, catalogue, jobs=request.jobs, progress=show)
    axes = list_axes(catalogue.rig().load_cell, TrialConfig(simulated=True))
    document = describe(study, catalogue, points)
    output.say(f'SIMULATED trials, {request.contact}; {document["split"]}')
    for axis in axes:
        for line in tell_axis(axis, points):
            output.say(f'  {line}')
    file.write_text(build_robustness_page(axes, points, document), encoding='utf-8')
    output.say(f'{file}: the same as a figure')
    output.result(document)
