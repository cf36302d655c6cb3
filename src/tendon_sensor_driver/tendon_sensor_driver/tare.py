# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The zero of the sensor: measured when asked for, taken off every sample, or refused."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
import threading

import numpy as np
from numpy.typing import NDArray

from tactile_ros.strain import NO_MEASUREMENT, StrainBlock, StrainStatus
from tendon_sensor_driver.errors import TendonSensorError
from tendon_sensor_driver.records import TendonSensorConfig

_BREAKS = {
    StrainStatus.RESTARTED: 'the device has restarted, or may have',
    StrainStatus.RECONNECTED: 'the link came back',
    StrainStatus.CLOCK_STEP: "the host's clock was set",
}
_ANY_BREAK = sum(int(bit) for bit in _BREAKS)
"""Samples from before these say nothing about the zero from then on."""


class TareError(TendonSensorError):
    """The last samples cannot be a zero.

    Attributes
    ----------
    code : str
        ``few``, ``old``, ``marked``, ``loaded``, ``moving`` or ``noisy``.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code


@dataclass(frozen=True)
class Bias:
    """Bias subtracted from every sample; mirrors ``tactile_msgs/Tare``."""

    stamp_ns: int  # time at which it was measured or cleared [ns]
    bias_n: float = 0.0  # mean of the tare samples [N]
    spread_n: float = 0.0  # their standard deviation [N]
    samples: int = 0  # number of tare samples; 0: no bias is subtracted


class Tare:
    """Keeps the last samples as they came, and the bias that is taken off.

    A tare is measured from samples that are there already, so it is answered at once: what
    was to be still must have been so for that many samples before. It is refused when there
    are not as many, when they are old, bad by status, spread too far, change over their
    length, or lie too far from the sensor's own zero: a loaded sensor. Samples from before a
    reconnection, a step of the host's clock or a silence of more than ``silence_s`` do not count.

    A device that restarted may have measured a zero of its own, as many load-cell boards do.
    Then the bias is a number about another zero, and is forgotten.

    Its methods may be called from several threads.
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._config = config
        self._lock = threading.Lock()
        self._blocks: deque[StrainBlock] = deque()
        self._samples = 0
        self._end_ns = 0  # of the newest block
        self._break = ''  # of the samples, before the first of those that are kept
        self._wrench_bias: NDArray[np.float64] | None = None
        self._bias = Bias(0)

    @property
    def bias(self) -> Bias:
        """Bias subtracted at present."""
        return self._bias

    def apply(self, block: StrainBlock) -> StrainBlock:
        """Take note of a block as it came, and return it with the bias taken off."""
        count = len(block.tension_n)
        with self._lock:
            silence_s = (block.stamp_ns - self._end_ns) / 1e9
            if int(block.status) & _ANY_BREAK:
                self._begin_anew(next(text for bit, text in _BREAKS.items() if block.status & bit))
            elif self._blocks and silence_s > self._config.silence_s:
                self._begin_anew(f'a silence of {silence_s:.1f} s')
            self._blocks.append(block)
            self._samples += count
            self._end_ns = block.stamp_ns + count * block.period_ns
            while self._samples - len(self._blocks[0].tension_n) >= self._config.tare_samples:
                self._samples -= len(self._blocks.popleft().tension_n)
            bias, wrench_bias = self._bias, self._wrench_bias
        if not bias.samples:
            return block
        wrench = block.wrench
        if wrench is not None and wrench_bias is not None:
            wrench = wrench - wrench_bias
        tension_n = block.tension_n - bias.bias_n
        tension_n.flags.writeable = False
        return replace(block, tension_n=tension_n, wrench=wrench)

    def measure(self, now_ns: int) -> Bias:
        """Take the mean of the last samples as the new bias.

        Raises
        ------
        TareError
            When they cannot be a zero; the bias stays as it was.
        """
        with self._lock:
            blocks = self._check(now_ns)
            bias = self._compute(blocks, now_ns)
            wrenches = [block.wrench for block in blocks if block.wrench is not None]
            self._wrench_bias = (
                np.concatenate(wrenches)[-bias.samples :].mean(axis=0) if wrenches else None
            )
            self._bias = bias
        return bias

    def clear(self, now_ns: int) -> Bias:
        """Take nothing off any more."""
        with self._lock:
            self._wrench_bias = None
            self._bias = Bias(now_ns)
        return self._bias

    def note_restart(self, now_ns: int) -> bool:
        """Forget samples and bias of a device that has restarted; return whether one was set."""
        with self._lock:
            self._begin_anew(_BREAKS[StrainStatus.RESTARTED])
        was_set = self._bias.samples > 0
        self.clear(now_ns)
        return was_set

    def compute_drift(self, now_ns: int) -> float | None:
        """Return how far the sensor's zero is from the bias [N]; None when it is not to be seen.

        It can be seen while a tare would be accepted.
        """
        if not self._bias.samples:
            return None
        with self._lock:
            try:
                bias = self._compute(self._check(now_ns), now_ns)
            except TareError:
                return None
        return bias.bias_n - self._bias.bias_n

    def _begin_anew(self, event: str) -> None:
        """Forget the samples: they say nothing about the zero after this event."""
        self._blocks.clear()
        self._samples = 0
        self._break = event

    def _check(self, now_ns: int) -> list[StrainBlock]:
        """Return the last blocks when there are enough, they are fresh and good."""
        blocks, config = list(self._blocks), self._config
        if self._samples < config.tare_samples:
            since = f' since {self._break}' if self._break else ''
            raise TareError(
                'few',
                f'only {self._samples} of {config.tare_samples} samples have come{since}; leave '
                'the sensor unloaded and try again',
            )
        silence_s = (now_ns - self._end_ns) / 1e9
        if silence_s > config.silence_s:
            raise TareError(
                'old', f'no sample for {silence_s:.1f} s; see the diagnostics of the sensor'
            )
        for block in blocks:
            if bad := block.status & NO_MEASUREMENT:
                raise TareError(
                    'marked', f'the last samples are marked {bad.describe()}; see the diagnostics'
                )
        return blocks

    def _compute(self, blocks: list[StrainBlock], now_ns: int) -> Bias:
        config = self._config
        tension_n = np.concatenate([block.tension_n for block in blocks])[-config.tare_samples :]
        mean_n, spread_n = float(tension_n.mean()), float(tension_n.std(ddof=1))
        # Rise of the regression line over all samples, on places from -1/2 to 1/2.
        places = np.linspace(-0.5, 0.5, len(tension_n))
        change_n = float(places @ (tension_n - mean_n) / (places @ places))
        if abs(mean_n) > config.tare_limit_n:
            raise TareError(
                'loaded',
                f'loaded: the mean is {mean_n:.2f} N without any tare, beyond tare_limit_n '
                f'({config.tare_limit_n:g} N); release the tendon',
            )
        if abs(change_n) > config.tare_change_n:
            raise TareError(
                'moving',
                f'moving: the tension changed by {change_n:.2f} N over {len(tension_n)} samples, '
                f'more than tare_change_n ({config.tare_change_n:g} N); hold still',
            )
        if spread_n > config.tare_spread_n:
            raise TareError(
                'noisy',
                f'noisy: the standard deviation is {spread_n:.3f} N, more than tare_spread_n '
                f'({config.tare_spread_n:g} N); look for loose contacts and vibration',
            )
        return Bias(now_ns, mean_n, spread_n, len(tension_n))
