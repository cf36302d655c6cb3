# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Signals as figures: one window a class in time and frequency, one trial with its phases."""

from __future__ import annotations

from matplotlib.figure import Figure
import numpy as np

from tactile_lab.plots import draw_spectrum, draw_strain, MARK_COLOUR, TRACE_COLOUR
from tactile_lab.report.analysis import SetResult
from tactile_lab.report.components import Components
from tactile_lab.report.figures.drawing import Drawing, render
from tactile_lab.report.published import is_the_papers
from tactile_lab.report.recordings import TrialExample

PAPER_TRIAL = (-0.90, 12.62, -0.99)
"""Slope [N/s], intercept [N] and correlation of the flexion trial of the paper's Fig. 7."""


def draw_textures(result: SetResult, components: Components) -> Drawing:
    """Draw one window a texture without its mean, and its spectrum, after the paper's Fig. 6."""
    recordings = result.recordings
    table = recordings.table
    factor, unit = (1e3, 'mN') if recordings.unit == 'N' else (1.0, recordings.unit)

    def draw(figure: Figure) -> None:
        rows = len(recordings.examples)
        left, right = figure.subplots(rows, 2, sharex='col', sharey='col', squeeze=False).T
        for axes, spectrum, example in zip(left, right, recordings.examples, strict=True):
            signal = factor * (example.signal - example.signal.mean())
            axes.plot(example.time_s, signal, color=TRACE_COLOUR, lw=0.8)
            axes.set_ylabel(table.labels[example.row], rotation=0, ha='right', va='center')
            axes.grid(alpha=0.2, lw=0.5)
            amplitudes = factor * table.values[example.row, components.columns]
            draw_spectrum(spectrum, components.frequency, amplitudes)
        left[0].set_title(f'signal without its mean [{unit}]')
        right[0].set_title(f'amplitude [{unit}]')
        left[-1].set_xlabel('time [s]')
        right[-1].set_xlabel(components.title)

    return render(
        draw,
        (6.6, 0.9 + 0.75 * len(recordings.examples)),
        f'{recordings.title}: the first trial of each class, in time (left, mean taken off) and '
        'as amplitudes of its Fourier components (right, logarithmic).',
        simulated=recordings.simulated,
    )


def draw_holds(result: SetResult) -> Drawing:
    """Draw one window an object with its regression."""
    recordings = result.recordings
    table = recordings.table
    columns = 3 if len(recordings.examples) > 2 else len(recordings.examples)
    rows = -(-len(recordings.examples) // columns)

    def draw(figure: Figure) -> None:
        grid = np.ravel(figure.subplots(rows, columns, sharex=True, squeeze=False))
        for axes, example in zip(grid, recordings.examples, strict=False):
            axes.plot(example.time_s, example.signal, color=TRACE_COLOUR, lw=0.9)
            fit = np.polynomial.Polynomial.fit(example.time_s, example.signal, 1)
            axes.plot(example.time_s, fit(example.time_s), color=MARK_COLOUR, lw=1)
            axes.set_title(table.labels[example.row])
            axes.grid(alpha=0.2, lw=0.5)
        for axes in grid[len(recordings.examples) :]:
            axes.set_visible(False)
        figure.supxlabel('time [s]', fontsize=8.5)
        figure.supylabel(f'signal [{recordings.unit}]', fontsize=8.5)

    return render(
        draw,
        (6.6, 0.6 + 1.5 * rows),
        f'{recordings.title}: the first hold of each object with its regression line. Each panel '
        'has its own scale.',
        simulated=recordings.simulated,
    )


def draw_trial(result: SetResult, trial: TrialExample) -> Drawing:
    """Draw one stiffness trial with its phases, after the paper's Fig. 7."""
    table = result.recordings.table
    named = dict(
        zip(
            (n.rpartition('__')[2] for n in table.spec.names), table.values[trial.row], strict=True
        )
    )
    line = (named['slope'], named['intercept']) if {'slope', 'intercept'} <= set(named) else None

    def draw(figure: Figure) -> None:
        trace = trial.trace
        draw_strain(
            figure.subplots(), trace.time_s, trace.tension_n, trace.phases, trial.window_s, line
        )

    found = ', '.join(f'{name} {value:.2f}' for name, value in named.items())
    slope, intercept, correlation = PAPER_TRIAL
    paper = (
        f' The flexion trial that the paper shows has slope {slope:.2f}, '
        f'intercept {intercept:.2f}, correlation {correlation:.2f}.'
        if is_the_papers(result)
        else ''
    )
    return render(
        draw,
        (6.6, 3.1),
        f'{result.recordings.title}: one trial on {table.labels[trial.row]}. Contact is the '
        'dynamic deformation, hold the static one, release the end of strain. '
        f'Between the dashes: {found}.{paper}',
        simulated=result.recordings.simulated,
    )
