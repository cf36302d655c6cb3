# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""`tactile replay`: a recording run again and compared with itself."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from domain_coordinator import domain_id

from tactile_bringup.bags import TactileBag
from tactile_bringup.commands.output import Output
from tactile_bringup.errors import BringupError
from tactile_bringup.graph_runner import ros_context
from tactile_bringup.model_folder import find_models
from tactile_bringup.replay import (
    Comparison,
    compare,
    load_models,
    recorded_config,
    recorded_results,
    replay_through_core,
)
from tactile_bringup.replay_nodes import replay_through_nodes


@dataclass(frozen=True)
class ReplayReport:
    """Comparisons of one finger's recording with its replays, by what was compared."""

    namespace: str
    comparisons: dict[str, Comparison]

    @property
    def is_equal(self) -> bool:
        return all(c.is_equal for c in self.comparisons.values())

    def to_dict(self) -> dict[str, Any]:
        """Return the report as what JSON can hold."""
        return {
            'namespace': self.namespace,
            'equal': self.is_equal,
            'comparisons': {name: asdict(c) for name, c in self.comparisons.items()},
        }


def run_replay(
    path: Path, model_folder: Path | None, *, through_nodes: bool, as_json: bool
) -> bool:
    """Replay a bag, print the comparison, return whether all is equal."""
    output = Output(as_json)
    reports = replay_and_compare(path, model_folder, through_nodes=through_nodes)
    for report in reports:
        print_report(report, output)
    equal = all(report.is_equal for report in reports)
    output.result({'bag': str(path), 'equal': equal, 'fingers': [r.to_dict() for r in reports]})
    return equal


def print_report(report: ReplayReport, output: Output) -> None:
    """Print one line for each comparison."""
    finger = f'{report.namespace}: ' if report.namespace else ''
    for name, comparison in report.comparisons.items():
        verdict = comparison.first_difference or 'equal, bit for bit'
        output.say(
            f'{finger}{name}: {verdict} ({comparison.window_count} feature windows, '
            f'{comparison.classification_count} classifications)'
        )


def replay_and_compare(
    path: Path, model_folder: Path | None, *, through_nodes: bool
) -> list[ReplayReport]:
    """Replay a bag through the core, and through nodes, and compare with the recording.

    Raises
    ------
    BringupError
        When the bag or the models cannot be used.
    """
    reports = []
    with TactileBag(path) as bag:
        folder = model_folder or _recorded_folder(bag)
        paths = find_models(folder) if folder else {}
        models = load_models(paths)
        config = recorded_config(bag)
        for namespace in bag.namespaces:
            recorded = recorded_results(bag, namespace)
            if not recorded.windows:
                if bag.facts.get('protocol') == 'slip':
                    raise BringupError(
                        f'{path} holds simulated slip trials: there are no slip features yet, '
                        'so there is nothing to replay'
                    )
                raise BringupError(
                    f'{path} holds no features: there is nothing to compare a replay with. '
                    'No trial ended while it was recorded, or it was made without nodes '
                    '(tactile simulate); tactile train and tactile evaluate take it all the same'
                )
            core = replay_through_core(bag, models, config, namespace)
            comparisons = {
                'recorded and plain core': compare(recorded, core, ('the recording', 'the core'))
            }
            if through_nodes:
                with domain_id() as domain, ros_context(int(domain)) as context:
                    nodes = replay_through_nodes(
                        bag, paths, config, context, expected=core, namespace=namespace
                    )
                comparisons['plain core and nodes'] = compare(
                    core, nodes, ('the core', 'the nodes')
                )
            reports.append(ReplayReport(namespace, comparisons))
    return reports


def _recorded_folder(bag: TactileBag) -> Path | None:
    """Return the folder of the models that the recording was made with, if any."""
    name = bag.facts.get('models', '')
    if not name:
        return None
    bag_folder = bag.path if bag.path.is_dir() else bag.path.parent
    folder = Path(bag_folder, name).resolve()
    if not folder.is_dir():
        raise BringupError(
            f'the models of this recording are not in {folder}; name their folder with --models'
        )
    return folder
