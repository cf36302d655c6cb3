# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Plots of signals: one trial over time, and spectra of plates.

`draw_strain` and `draw_spectrum` draw on given axes; the report uses them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tactile_bags.trial import Signal, Trial

TRACE_COLOUR = '#2a6fb0'
MARK_COLOUR = '#c0392b'

UNKNOWN_UNITS = ('', 'raw')
"""Values of a recording's unit if the unit is not known."""

PHASE_COLOURS: dict[str | None, str] = {
    None: '#909090',
    'contact': '#4a90d9',
    'glide': '#5aae61',
    'hold': '#5aae61',
    'release': '#e08214',
}
"""Colours of the phases, as on the live page. The key None is for all other phases."""


def plot_strain(
    path: Path,
    time_s: NDArray[np.float64],
    tension_n: NDArray[np.float64],
    phases: Sequence[tuple[str, float, float]],
    title: str,
    window_s: tuple[float, float] | None = None,
    line: tuple[float, float] | None = None,
) -> None:
    """Draw the tension of one trial with its phases to a PNG file; see `draw_strain`.

    The title states the source of the trial, including "simulated".
    """
    figure = Figure(figsize=(9, 4), layout='constrained')
    axes = figure.subplots()
    draw_strain(axes, time_s, tension_n, phases, window_s, line)
    axes.set_title(title)
    figure.savefig(path, dpi=130)


def plot_signals(
    path: Path, signals: Sequence[tuple[str, Signal]], window_s: float | None = None
) -> None:
    """Draw trials recorded by other software: one panel per trial, with all channels.

    ``signals`` are pairs of title and signal. ``window_s`` is the length of the feature window,
    which begins with the trial [s].
    """
    figure = Figure(figsize=(9, 1.2 + 2.8 * len(signals)), layout='constrained')
    panels = np.ravel(figure.subplots(len(signals), 1, squeeze=False))
    for axes, (title, signal) in zip(panels, signals, strict=True):
        count = signal.values.shape[1]
        time_s = np.arange(count) if signal.time_s is None else signal.time_s - signal.time_s[0]
        for i, values in enumerate(signal.values):
            colour = TRACE_COLOUR if i == 0 else f'C{i}'
            axes.plot(time_s, values, color=colour, lw=1, label=signal.channels[i])
        if window_s is not None and signal.time_s is not None:
            shade_phases(axes, [('window', 0.0, window_s)])
        axes.set(
            title=title,
            xlabel='sample (the rate is unknown)' if signal.time_s is None else 'time [s]',
            ylabel=label_axis('signal', signal.unit),
        )
        if 1 < len(signal.values) <= 10:
            axes.legend()
    figure.savefig(path, dpi=130)


def plot_all_trials(path: Path, trials: Sequence[Trial]) -> None:
    """Draw the trials of an experiment: a row per object, a column per contact.

    Each session has a colour; excluded trials are grey. Times count from the start of the touch
    phase, if there is one.
    """
    objects = sorted({trial.label for trial in trials})
    contacts = sorted({trial.contact for trial in trials})
    sessions = list(dict.fromkeys(trial.session_id for trial in trials))
    figure = Figure(figsize=(5.0 * len(contacts), 0.8 + 1.7 * len(objects)), layout='constrained')
    grid = figure.subplots(len(objects), len(contacts), squeeze=False, sharex=True, sharey=True)
    for trial in sorted(trials, key=lambda trial: not trial.why_not):  # grey lines first
        axes = grid[objects.index(trial.label)][contacts.index(trial.contact)]
        colour = '#bbbbbb' if trial.why_not else f'C{sessions.index(trial.session_id) % 10}'
        signal = trial.signal
        time_s = np.arange(signal.values.shape[1]) if signal.time_s is None else signal.time_s
        contact_s = next((start for name, start, _ in trial.phases if name == 'contact'), 0.0)
        axes.plot(time_s - contact_s, signal.values[0], color=colour, lw=0.7)
    for row, label in enumerate(objects):
        for column, contact in enumerate(contacts):
            title = f'{label}, {contact}' if contact else label
            grid[row][column].set_title(title, fontsize=9, loc='left')
    for i, session in enumerate(sessions):
        grid[0][0].plot([], [], color=f'C{i % 10}', label=session or 'no session')
    if any(trial.why_not for trial in trials):
        grid[0][0].plot([], [], color='#bbbbbb', label='excluded')
    simulated = 'SIMULATED' if any(trial.simulated for trial in trials) else None
    legend_outside(
        figure,
        'upper center',
        ncols=min(6, len(sessions) + 1),
        frameon=False,
        title=simulated,
        title_fontproperties={'weight': 'bold'},
    )
    figure.supxlabel('time [s]')
    figure.supylabel('tension [N]')
    figure.savefig(path, dpi=130)


def plot_accuracy_by_length(
    path: Path, curves: Mapping[str, Sequence[tuple[float, float]]], *, simulated: bool
) -> None:
    """Draw the error rate of models against the length of their window.

    ``curves`` has a list of pairs for each model: window length [s] and accuracy [1].
    """
    figure = Figure(figsize=(6.2, 3.6), layout='constrained')
    axes = figure.subplots()
    for name, points in curves.items():
        seconds, accuracies = zip(*sorted(points), strict=True)
        errors = [100.0 * (1.0 - accuracy) for accuracy in accuracies]
        axes.plot(seconds, errors, 'o-', ms=4, lw=1.2, label=name)
    axes.set(xlim=(0, None), ylim=(0, None), xlabel='window [s]', ylabel='wrong labels [%]')
    axes.set_title('SIMULATED' if simulated else '', fontsize=9)
    axes.grid(alpha=0.2, lw=0.5)
    if curves:
        legend_outside(figure, 'lower center', fontsize=8)
    figure.savefig(path, dpi=130)


def legend_outside(figure: Figure, loc: str, **options: Any) -> None:
    """Draw the legend of a figure with constrained layout outside its panels.

    Matplotlib supports this as ``loc='outside ...'`` from version 3.7 on.

    Parameters
    ----------
    loc : {'upper center', 'lower center', 'upper right'}
        Position of the legend: a strip above or below the panels, or beside them for
        'upper right'.
    **options
        Arguments of `matplotlib.figure.Figure.legend`.
    """
    legend = figure.legend(loc=loc, **options)
    box = legend.get_window_extent().transformed(figure.transFigure.inverted())
    width, height = box.width + 0.02, box.height + 0.02
    free = {
        'upper center': (0.0, 0.0, 1.0, 1.0 - height),
        'lower center': (0.0, height, 1.0, 1.0 - height),
        'upper right': (0.0, 0.0, 1.0 - width, 1.0),
    }
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=free[loc])


def draw_strain(
    axes: Axes,
    time_s: NDArray[np.float64],
    tension_n: NDArray[np.float64],
    phases: Sequence[tuple[str, float, float]],
    window_s: tuple[float, float] | None = None,
    line: tuple[float, float] | None = None,
) -> None:
    """Draw the tension of one trial with its phases.

    ``phases`` are tuples of name, start and end. ``window_s`` are the times of the first and the
    last sample of the feature window. All times [s] count from the same moment as ``time_s``.
    ``line`` is drawn over the window: slope [N/s], and intercept at the start of the window [N].
    """
    shade_phases(axes, phases)
    axes.plot(time_s, tension_n, color=TRACE_COLOUR, lw=1)
    if window_s is not None:
        for at_s in window_s:
            axes.axvline(at_s, color=MARK_COLOUR, lw=0.8, ls='--')
        if line is None:
            axes.plot([], [], color=MARK_COLOUR, lw=0.8, ls='--', label='feature window')
        else:
            slope, intercept = line
            times = np.array(window_s)
            axes.plot(
                times,
                intercept + slope * (times - times[0]),
                color=MARK_COLOUR,
                lw=1.5,
                label=f'slope {slope:.3f} N/s, intercept {intercept:.2f} N (least squares)',
            )
        axes.legend(loc='lower center', frameon=False)
    axes.set(xlabel='time [s]', ylabel='tension [N]')
    low, high = float(np.min(tension_n)), float(np.max(tension_n))
    axes.set_ylim(low - 0.05 * (high - low) - 1e-3, high + 0.15 * (high - low) + 1e-3)
    axes.set_xlim(phases[0][1], phases[-1][2])


def label_axis(quantity: str, unit: str) -> str:
    """Return the label of an axis: the quantity with its unit, or a remark if it is unknown."""
    return f'{quantity} (unit unknown)' if unit in UNKNOWN_UNITS else f'{quantity} [{unit}]'


def shade_phases(axes: Axes, phases: Sequence[tuple[str, float, float]]) -> None:
    """Shade each phase in its colour, and write the names of long phases."""
    for name, start, end in phases:
        axes.axvspan(
            start, end, color=PHASE_COLOURS.get(name, PHASE_COLOURS[None]), alpha=0.18, lw=0
        )
        if end - start > 0.06 * (phases[-1][2] - phases[0][1]):
            axes.text(
                (start + end) / 2,
                0.98,
                name,
                transform=axes.get_xaxis_transform(),
                ha='center',
                va='top',
                fontsize=9,
            )


def plot_spectra(
    path: Path,
    frequency_hz: NDArray[np.float64],
    spectra: Sequence[tuple[str, NDArray[np.float64]]],
    title: str,
) -> None:
    """Draw one amplitude spectrum per texture to a PNG file, with common axis limits.

    ``spectra`` are pairs of label and amplitudes [N]. The amplitudes and ``frequency_hz`` [Hz]
    have shape (k,).
    """
    rows = (len(spectra) + 1) // 2
    height = 1.5 * rows + 0.8
    figure = Figure(figsize=(9, height))
    # A constrained layout would draw all axes twice, which takes 0.7 s for eight spectra.
    figure.subplots_adjust(
        left=0.09, right=0.99, bottom=0.55 / height, top=1 - 0.35 / height, wspace=0.04, hspace=0.1
    )
    grid = np.ravel(figure.subplots(rows, 2, sharex=True, sharey=True))
    for axes, (label, amplitude_n) in zip(grid, spectra, strict=False):
        draw_spectrum(axes, frequency_hz, 1e3 * amplitude_n)
        axes.text(0.98, 0.9, label, transform=axes.transAxes, ha='right', va='top', weight='bold')
    for axes in grid[len(spectra) :]:
        axes.set_visible(False)
    figure.supxlabel('frequency [Hz]')
    figure.supylabel('amplitude [mN]')
    figure.suptitle(title)
    figure.savefig(path, dpi=130)


def draw_spectrum(
    axes: Axes, frequency_hz: NDArray[np.float64], amplitude: NDArray[np.float64]
) -> None:
    """Draw one amplitude spectrum. The vertical axis has the unit of ``amplitude``."""
    # The scale is logarithmic: creep of the finger causes large amplitudes at low frequencies, and
    # the grooves of the plates cause much smaller ones. Frequency zero is omitted, because the
    # mean has been subtracted from the signal.
    above = frequency_hz > 0
    axes.semilogy(frequency_hz[above], amplitude[above], color=TRACE_COLOUR, lw=1)
    axes.grid(alpha=0.3)
