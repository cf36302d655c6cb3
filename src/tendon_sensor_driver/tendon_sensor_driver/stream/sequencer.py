# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Samples to numbered blocks: what was lost, and what belongs together."""

from __future__ import annotations

import numpy as np

from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.stream.clock import Instant


class Sequencer:
    """Numbers samples by device time and groups them into blocks.

    The samples lost before one are the device time since the one before, in whole
    periods, less one. Only neighbours are compared, so ticks coarser than the period's
    fraction and a device rate a little off the nominal one never add up to a false gap;
    a gap of some thousand samples is still counted exactly at 100 ppm.

    A block ends when it is full, before a gap, before a change of status, and before a
    sample whose stamp is more than half a period from where the block would put it.

    Parameters
    ----------
    period_ns : int
        Nominal time between two samples [ns].
    samples_per_block : int
        Samples in a full block.

    Attributes
    ----------
    lost_samples : int
        Sum over all gaps.
    """

    def __init__(self, period_ns: int, samples_per_block: int) -> None:
        self._period_ns = period_ns
        self._samples_per_block = samples_per_block
        self.lost_samples = 0
        self._sequence = -1
        self._device_ns: int | None = None
        # The block under construction.
        self._tensions_n: list[float] = []
        self._wrenches: list[list[float]] = []
        self._first = Instant(None, 0, 0.0)
        self._first_sequence = 0
        self._lost_before = 0
        self._error_s = 0.0
        self._status = StrainStatus.OK
        self._status_of_samples = StrainStatus.OK

    def add(
        self,
        instant: Instant,
        tension_n: float,
        status: StrainStatus = StrainStatus.OK,
        event: StrainStatus = StrainStatus.OK,
        wrench: list[float] | None = None,
    ) -> list[StrainBlock]:
        """Take one sample; return the blocks that it completes, at most two.

        Parameters
        ----------
        instant : Instant
            When it was taken; later than the sample before.
        tension_n : float
            Tension [N].
        status : StrainStatus
            What holds for this sample.
        event : StrainStatus
            What happened since the sample before; begins a new block, which carries it.
        wrench : list of 6 floats, optional
            Of a six-axis sensor [N, N m].
        """
        lost = self._count_lost(instant)
        self.lost_samples += lost
        self._sequence += lost + 1
        blocks: list[StrainBlock] = []
        misfit_ns = abs(
            instant.stamp_ns - self._first.stamp_ns - len(self._tensions_n) * self._period_ns
        )
        if lost or event or status != self._status_of_samples or 2 * misfit_ns > self._period_ns:
            blocks += self.flush()
        if not self._tensions_n:
            misfit_ns = 0
            self._begin_block(instant, lost, status, event)
        self._tensions_n.append(tension_n)
        if wrench is not None:
            self._wrenches.append(wrench)
        self._widen_error(instant.stamp_error_s, misfit_ns)
        if len(self._tensions_n) == self._samples_per_block:
            blocks += self.flush()
        return blocks

    def flush(self) -> list[StrainBlock]:
        """Return the unfinished block, if there is one, as it is."""
        if not self._tensions_n:
            return []
        tension_n = np.array(self._tensions_n, dtype=np.float64)
        tension_n.flags.writeable = False  # neighbours in the process look at it, too
        block = StrainBlock(
            stamp_ns=self._first.stamp_ns,
            sequence=self._first_sequence,
            period_ns=self._period_ns,
            tension_n=tension_n,
            lost_before=self._lost_before,
            stamp_error_s=self._error_s,
            status=self._status,
            wrench=np.array(self._wrenches) if self._wrenches else None,
        )
        self._tensions_n = []
        self._wrenches = []
        return [block]

    def _begin_block(
        self, instant: Instant, lost: int, status: StrainStatus, event: StrainStatus
    ) -> None:
        self._first = instant
        self._first_sequence = self._sequence
        self._lost_before = lost
        self._error_s = instant.stamp_error_s
        self._status = status | event if event else status
        self._status_of_samples = status

    def _widen_error(self, error_s: float, misfit_ns: int) -> None:
        if self._error_s >= 0:
            self._error_s = max(self._error_s, error_s + misfit_ns / 1e9) if error_s >= 0 else -1.0

    def _count_lost(self, instant: Instant) -> int:
        before_ns, self._device_ns = self._device_ns, instant.device_ns
        if before_ns is None or self._device_ns is None or instant.is_restart:
            return 0
        elapsed_ns = self._device_ns - before_ns
        periods = (2 * elapsed_ns + self._period_ns) // (2 * self._period_ns)
        return max(periods, 1) - 1
