# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figures as SVG elements that are embedded in a page and use its text colour."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
import io
import re

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from tactile_analysis.plots import legend_outside

INK = '#1b1b1c'
"""Colour in the figures that `_clean` replaces by the text colour of the page."""

CLASSIFIER_COLOURS = {
    'knn': '#2a78b8',
    'svm_linear': '#d98c00',
    'svm_rbf': '#c0392b',
    'tree': '#3a9d5d',
    'rocket': '#7b5aa6',
}
"""Colour of each classifier. Readers with red-green blindness can distinguish the colours."""

WIDTH_IN = 5.2
"""Width of the wider figures [inch]. On a screen of 390 px they are scaled by 0.7, and their text
is still legible."""

_MOST_SCALE = 1.15

_STYLE = {
    'axes.edgecolor': INK,
    'axes.facecolor': 'none',
    'axes.labelcolor': INK,
    'axes.spines.right': False,
    'axes.spines.top': False,
    'axes.titlesize': 9,
    'figure.facecolor': 'none',
    'font.size': 8.5,
    'grid.color': INK,
    'legend.frameon': False,
    'savefig.transparent': True,
    'svg.fonttype': 'none',
    'svg.hashsalt': 'tactile',
    'text.color': INK,
    'xtick.color': INK,
    'ytick.color': INK,
}


@dataclass(frozen=True)
class Drawing:
    """A figure of the report.

    ``svg`` is an HTML element with the text alternative as its label. ``caption`` explains
    quantities and symbols.
    """

    svg: str
    caption: str


def render(
    draw: Callable[[Figure], None],
    size_in: tuple[float, float],
    caption: str,
    message: str,
    *,
    simulated: bool,
) -> Drawing:
    """Call ``draw`` with an empty figure of size ``size_in`` [inch], and return the figure as SVG.

    ``message`` is the text alternative, which contains the numbers of the figure. If ``simulated``
    is True, figure, caption and text alternative are marked as SIMULATED.
    """
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=size_in)
        layout = ConstrainedLayoutEngine()
        figure.set_layout_engine(layout)
        draw(figure)
        if simulated:
            figure.text(
                0.5,
                0.5,
                'SIMULATED',
                ha='center',
                va='center',
                rotation=25,
                fontsize=9 * size_in[0],
                alpha=0.07,
                weight='bold',
                zorder=10,
            )
        layout.execute(figure)
        figure.set_layout_engine('none')
        stream = io.StringIO()
        # If a figure has had a layout engine, savefig would draw it twice. print_svg does not.
        metadata = {'Date': None, 'Creator': None}
        canvas = FigureCanvasSVG(figure)
        canvas.print_svg(stream, metadata=metadata)  # type: ignore[no-untyped-call]
    prefix = 'SIMULATED. ' if simulated else ''
    width_px = 96 * size_in[0]
    head = (
        f'<svg role="img" aria-label="{escape(prefix + message)}" '
        f'style="max-width:{_MOST_SCALE * width_px:.0f}px" '
    )
    svg = _clean(stream.getvalue()).replace('<svg ', head, 1)
    return Drawing(svg, prefix + caption)


def legend_below(figure: Figure, axes: Axes) -> None:
    """Draw the legend of ``axes`` below the figure, in three columns."""
    handles, labels = axes.get_legend_handles_labels()
    legend_outside(figure, 'lower center', handles=handles, labels=labels, ncols=3, fontsize=8)


def _clean(svg: str) -> str:
    """Return only the SVG element, in the text colour of the page.

    Ids that could occur in another figure of the page are removed.
    """
    svg = svg[svg.index('<svg') :]
    svg = re.sub(r'<metadata>.*?</metadata>', '', svg, flags=re.DOTALL)
    # Ids of groups are the same in every figure, and are removed. Ids that are referenced within
    # the figure are hashes, and are kept.
    svg = re.sub(r' id="(?![mp][0-9a-f]{10}")[^"]*"', '', svg)
    svg = svg.replace(INK, 'currentColor')
    svg = re.sub(r"font: ([^;\"]*?)'[^;\"]*(sans-serif)", r'font: \1\2', svg)
    return re.sub(r' width="[\d.]+pt" height="[\d.]+pt"', '', svg, count=1)
