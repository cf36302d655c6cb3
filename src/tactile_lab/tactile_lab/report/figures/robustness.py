# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy against what gets worse, as one figure, with the numbers below it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from tactile_lab.report.build import fill_template
from tactile_lab.report.provenance import find_versions
from tactile_lab.report.svg import Drawing, INK, legend_below, render
from tactile_lab.simulation.robustness import Point
from tactile_lab.simulation.robustness_axes import Axis

_COLOURS = {'texture': '#2a78b8', 'stiffness': '#d98c00'}
_LOGARITHMIC = ('noise', 'drift', 'sample rate')


def _draw_robustness(axes_of: Sequence[Axis], points: Sequence[Point]) -> Drawing:
    """Draw one panel a condition, a colour for each task."""

    def draw(figure: Figure) -> None:
        columns = 2
        rows = -(-len(axes_of) // columns)
        grid = np.ravel(figure.subplots(rows, columns, sharey=True))
        for panel, axis in zip(grid, axes_of, strict=False):
            _draw_axis(panel, axis, points)
        for panel in grid[len(axes_of) :]:
            panel.set_visible(False)
        for panel in grid[::columns]:
            panel.set_ylabel('named correctly [%]')
        legend_below(figure, grid[0], 2)

    return render(
        draw,
        (6.6, 8.6),
        'Share of all tested trials that are named correctly while one condition gets worse. '
        'Lines: trained under the usual conditions (upright thin line). Dashes: trained under '
        'the same conditions as tested. A trial without features counts as not named.',
        'Share of trials named correctly. '
        + '; '.join(line for axis in axes_of for line in tell_axis(axis, points)),
        simulated=True,
    )


def _draw_axis(panel: Axes, axis: Axis, points: Sequence[Point]) -> None:
    for protocol, colour in _COLOURS.items():
        here = [p for p in points if (p.protocol, p.axis) == (protocol, axis.name)]
        for style, kind in (('o-', 'nominal'), ('s--', 'matched')):
            shown = [p for p in here if getattr(p, kind) is not None]
            panel.plot(
                [p.value for p in shown],
                [100 * getattr(p, kind) for p in shown],
                style,
                ms=3,
                lw=1.2,
                color=colour,
                label=f'{protocol}, '
                + ('trained as usual' if kind == 'nominal' else 'trained as tested'),
            )
    panel.axvline(axis.nominal, color=INK, lw=0.6, alpha=0.5)
    if axis.name in _LOGARITHMIC:
        panel.set_xscale('log')
        values = sorted({p.value for p in points if p.axis == axis.name})
        panel.set_xticks(values, [f'{value:.3g}' for value in values])
        panel.minorticks_off()
    panel.set(ylim=(0, 104), title=f'{axis.name} [{axis.unit}]')
    panel.grid(alpha=0.2, lw=0.5)


def tell_axis(axis: Axis, points: Sequence[Point]) -> list[str]:
    """Return one line a task: the accuracies along the axis."""
    lines = []
    for protocol in _COLOURS:
        here = [p for p in points if (p.protocol, p.axis) == (protocol, axis.name)]
        if here:
            steps = ', '.join(
                f'{p.value:.3g}: {_percent(p.nominal)} / {_percent(p.matched)}' for p in here
            )
            lines.append(f'{axis.name} ({axis.unit}), {protocol}: {steps}')
    return lines


def _percent(share: float | None) -> str:
    return 'none' if share is None else f'{100 * share:.0f} %'


def build_robustness_page(
    axes_of: Sequence[Axis], points: Sequence[Point], document: Mapping[str, Any]
) -> str:
    """Return the study as an HTML file that needs no other."""
    return fill_template(
        'robustness.html',
        title='Touch through the tendon: how good must sensor and rig be?',
        simulated=True,
        drawing=_draw_robustness(axes_of, points),
        tables=[
            (
                f'{axis.name} [{axis.unit}]; {document["split"]}',
                ['task', axis.name, 'trained as usual', 'trained as tested', 'without features'],
                [
                    [
                        p.protocol,
                        f'{p.value:.3g}',
                        *map(_percent, (p.nominal, p.matched, p.refused)),
                    ]
                    for p in points
                    if p.axis == axis.name
                ],
            )
            for axis in axes_of
        ],
        document=document,
        versions=find_versions(),
    )
