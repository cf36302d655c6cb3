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

"""`tactile robustness`: how good sensor and rig must be, on simulated trials."""

from __future__ import annotations

from pathlib import Path

from tactile_bringup.records import TrialConfig
from tactile_lab.commands.output import Output
from tactile_lab.report.build import report_path
from tactile_lab.report.figures.robustness import build_robustness_page, tell_axis
from tactile_lab.simulation.robustness import describe, run_study, Study
from tactile_lab.simulation.robustness_axes import list_axes
from tactile_sim.descriptions.catalogue import Catalogue


def run_robustness(
    report: Path,
    *,
    contact: str,
    description: Path | None,
    seed: int,
    jobs: int,
    as_json: bool,
) -> None:
    """Run the study, print a line an axis, write the report."""
    output = Output(as_json)
    file = report_path(report)
    study, catalogue = Study(contact=contact, seed=seed), Catalogue(description)
    with output.progress() as progress:
        bar = progress.add_task('simulating conditions', total=None)
        points = run_study(
            study,
            catalogue,
            jobs=jobs,
            progress=lambda done, total: progress.update(bar, completed=done, total=total),
        )
    axes = list_axes(catalogue.rig().load_cell, TrialConfig(simulated=True))
    document = describe(study, catalogue, points)
    output.say(f'SIMULATED trials, {contact}; {document["split"]}')
    for axis in axes:
        for line in tell_axis(axis, points):
            output.say(f'  {line}')
    file.write_text(build_robustness_page(axes, points, document), encoding='utf-8')
    output.say(f'{file}: the same as a figure')
    output.result(document)
