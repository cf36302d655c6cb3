# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figures as SVG inside a page: they take its colour of text, and it needs no other file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
import io
import re

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from tactile_analysis.plots import legend_outside

INK = '#1b1b1c'
"""Stands for the page's colour of text, light or dark."""

CLASSIFIER_COLOURS = {
    'knn': '#2a78b8',
    'svm_linear': '#d98c00',
    'svm_rbf': '#c0392b',
    'tree': '#3a9d5d',
    'rocket': '#7b5aa6',
}
"""Told apart with red-green blindness, too, and on white as on black."""

_LEAST_SCALE = 0.7
"""Smallest scale at which the texts of a figure can be read on a phone [1]."""

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

    ``svg`` is an element that may stand inside HTML; its label is the text alternative. The
    caption names quantities and marks. Below ``least_px`` its texts cannot be read: it scrolls.
    """

    svg: str
    caption: str
    least_px: int


def render(
    draw: Callable[[Figure], None],
    size_in: tuple[float, float],
    caption: str,
    message: str,
    *,
    simulated: bool,
) -> Drawing:
    """Let ``draw`` draw on an empty figure of this size [inch], and return it as SVG.

    The ``message`` is the text alternative: that of the figure, with its numbers. Figure and both
    texts say so where they show simulated data.
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
        # savefig draws a figure that has a layout engine twice.
        layout.execute(figure)
        figure.set_layout_engine('none')
        stream = io.StringIO()
        figure.savefig(stream, format='svg', metadata={'Date': None, 'Creator': None})
    prefix = 'SIMULATED. ' if simulated else ''
    width_px = 96 * size_in[0]
    head = (
        f'<svg role="img" aria-label="{escape(prefix + message)}" '
        f'style="max-width:{_MOST_SCALE * width_px:.0f}px" '
    )
    svg = _clean(stream.getvalue()).replace('<svg ', head, 1)
    return Drawing(svg, prefix + caption, round(_LEAST_SCALE * width_px))


def legend_below(figure: Figure, axes: Axes) -> None:
    """Put the legend of some axes below the whole figure, in three columns."""
    handles, labels = axes.get_legend_handles_labels()
    legend_outside(figure, 'lower center', handles=handles, labels=labels, ncols=3, fontsize=8)


def _clean(svg: str) -> str:
    """Return the SVG element alone, in the page's colour of text, without what repeats."""
    svg = svg[svg.index('<svg') :]
    svg = re.sub(r'<metadata>.*?</metadata>', '', svg, flags=re.DOTALL)
    # Names of groups would come again in the next figure; what is referred to is a hash.
    svg = re.sub(r' id="(?![mp][0-9a-f]{10}")[^"]*"', '', svg)
    svg = svg.replace(INK, 'currentColor')
    svg = re.sub(r"font: ([^;\"]*?)'[^;\"]*(sans-serif)", r'font: \1\2', svg)
    return re.sub(r' width="[\d.]+pt" height="[\d.]+pt"', '', svg, count=1)
