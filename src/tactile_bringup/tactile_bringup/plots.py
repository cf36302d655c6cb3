# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The two plots that show what the finger felt: one trial in time, the spectra of the plates."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray

matplotlib.use('Agg')
import matplotlib.pyplot as plt

PHASE_COLOURS = {
    'approach': '0.92',
    'contact': '#cfe3f5',
    'glide': '#d9f0d3',
    'hold': '#d9f0d3',
    'release': '#fbe3c8',
    'return': '0.92',
}


def plot_strain(
    path: Path,
    time_s: NDArray[np.float64],
    tension_n: NDArray[np.float64],
    phases: Sequence[tuple[str, float, float]],
    title: str,
    window_s: tuple[float, float] | None = None,
    line: tuple[float, float] | None = None,
) -> None:
    """Draw the tension of one trial with its phases.

    Parameters
    ----------
    path : pathlib.Path
        PNG to write.
    time_s, tension_n : ndarray of shape (n,)
        Time since the trial's start [s] and tension [N].
    phases : sequence of (name, start, end)
        Times in seconds on the same axis.
    title : str
        States where the trial comes from, "simulated" included.
    window_s : tuple, optional
        First and last sample of the window that the features come from.
    line : tuple, optional
        Slope [N/s] and intercept [N] at the window's start, drawn over the window.
    """
    figure, axes = plt.subplots(figsize=(9, 4), layout='constrained')
    for name, start, end in phases:
        axes.axvspan(start, end, color=PHASE_COLOURS.get(name, '0.95'), lw=0)
        if end - start > 0.02 * (phases[-1][2] - phases[0][1]):
            axes.text(
                (start + end) / 2,
                0.98,
                name,
                transform=axes.get_xaxis_transform(),
                ha='center',
                va='top',
                fontsize=9,
            )
    axes.plot(time_s, tension_n, color='#1f4e79', lw=1)
    if window_s is not None:
        for at_s in window_s:
            axes.axvline(at_s, color='#c00000', lw=0.8, ls='--')
        if line is None:
            axes.plot([], [], color='#c00000', lw=0.8, ls='--', label='feature window')
        else:
            slope, intercept = line
            times = np.array(window_s)
            axes.plot(
                times,
                intercept + slope * (times - times[0]),
                color='#c00000',
                lw=1.5,
                label=f'least squares: {intercept:.2f} N {slope:+.3f} N/s',
            )
        axes.legend(loc='lower center', frameon=False)
    axes.set(xlabel='time [s]', ylabel='tension [N]', title=title)
    low, high = float(np.min(tension_n)), float(np.max(tension_n))
    axes.set_ylim(low - 0.05 * (high - low) - 1e-3, high + 0.15 * (high - low) + 1e-3)
    axes.set_xlim(phases[0][1], phases[-1][2])
    figure.savefig(path, dpi=130)
    plt.close(figure)


def plot_spectra(
    path: Path,
    frequency_hz: NDArray[np.float64],
    spectra: Sequence[tuple[str, NDArray[np.float64]]],
    title: str,
) -> None:
    """Draw one amplitude spectrum a texture, all on the same axes' limits.

    Parameters
    ----------
    path : pathlib.Path
        PNG to write.
    frequency_hz : ndarray of shape (k,)
    spectra : sequence of (label, ndarray of shape (k,))
        Amplitudes [N].
    title : str
    """
    rows = (len(spectra) + 1) // 2
    figure, grid = plt.subplots(
        rows, 2, figsize=(9, 1.5 * rows + 0.8), sharex=True, sharey=True, layout='constrained'
    )
    for axes, (label, amplitude_n) in zip(np.ravel(grid), spectra, strict=False):
        # Logarithmic: the trend of creep is many times as high as the grooves' peaks. The first
        # amplitude is that of the mean, which has been taken off.
        axes.semilogy(frequency_hz[1:], 1e3 * amplitude_n[1:], color='#1f4e79', lw=1)
        axes.text(0.98, 0.9, label, transform=axes.transAxes, ha='right', va='top', weight='bold')
        axes.grid(alpha=0.3)
    for axes in np.ravel(grid)[len(spectra) :]:
        axes.set_visible(False)
    figure.supxlabel('frequency [Hz]')
    figure.supylabel('amplitude [mN]')
    figure.suptitle(title)
    figure.savefig(path, dpi=130)
    plt.close(figure)
