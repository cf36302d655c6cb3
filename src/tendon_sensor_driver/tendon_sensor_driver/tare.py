# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tare of the sensor, which is measured on request and subtracted from every sample."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
import threading

import numpy as np
from numpy.typing import NDArray

from tactile_ros.strain import NO_MEASUREMENT, StrainBlock, StrainStatus
from tendon_sensor_driver.config import TendonSensorConfig
from tendon_sensor_driver.errors import TendonSensorError

_BREAKS = {
    StrainStatus.RESTARTED: 'the device has restarted, or may have restarted',
    StrainStatus.RECONNECTED: 'the link came back',
    StrainStatus.CLOCK_STEP: "the host's clock was set",
}
_ANY_BREAK = sum(int(bit) for bit in _BREAKS)
"""Status bits after which earlier samples can no longer be used for a tare."""


class TareError(TendonSensorError):
    """The latest samples cannot be used as a tare.

    Attributes
    ----------
    code : str
        The reason: ``few``, ``old``, ``marked`` (by an error status), ``loaded``, ``moving`` or
        ``noisy``.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code


@dataclass(frozen=True)
class TareValue:
    """Result of a tare, with the same content as ``tactile_msgs/Tare``."""

    stamp_ns: int  # time at which the tare was measured or cleared [ns]
    tare_n: float = 0.0  # mean of the tare samples [N]
    spread_n: float = 0.0  # standard deviation of the tare samples [N]
    samples: int = 0  # number of tare samples; 0: no tare is subtracted


class Tare:
    """Measures the tare from the latest samples and subtracts it from every block.

    The tare is the mean of the last ``tare_samples`` samples before the request, during which the
    finger must be unloaded and still. A request is refused if there are too few samples, or if
    the samples are old, have an error status, are noisy, drift, or show a load. Samples are no
    longer used after a reconnection, after the host's clock was set, or after a silence of more
    than ``silence_s``.

    Many load-cell boards set their own zero when they start. The tare is therefore cleared when
    the device restarts.

    All methods are thread-safe.
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._config = config
        self._lock = threading.Lock()
        self._blocks: deque[StrainBlock] = deque()
        self._samples = 0
        self._end_ns = 0  # time of the end of the newest block
        self._break: str | None = None  # reason why earlier samples were dropped, for messages
        self._wrench_tare: NDArray[np.float64] | None = None
        self._value = TareValue(0)

    @property
    def value(self) -> TareValue:
        """The present tare."""
        return self._value

    def apply(self, block: StrainBlock) -> StrainBlock:
        """Subtract the present tare from a block, and store the block for the next tare."""
        count = len(block.tension_n)
        with self._lock:
            silence_s = (block.stamp_ns - self._end_ns) / 1e9
            if int(block.status) & _ANY_BREAK:
                self._drop_samples(
                    next(text for bit, text in _BREAKS.items() if block.status & bit)
                )
            elif self._blocks and silence_s > self._config.silence_s:
                self._drop_samples(f'a silence of {silence_s:.1f} s')
            self._blocks.append(block)
            self._samples += count
            self._end_ns = block.stamp_ns + count * block.period_ns
            while self._samples - len(self._blocks[0].tension_n) >= self._config.tare_samples:
                self._samples -= len(self._blocks.popleft().tension_n)
            value, wrench_tare = self._value, self._wrench_tare
        if not value.samples:
            return block
        wrench = block.wrench
        if wrench is not None and wrench_tare is not None:
            wrench = wrench - wrench_tare
        tension_n = block.tension_n - value.tare_n
        tension_n.flags.writeable = False
        return replace(block, tension_n=tension_n, wrench=wrench)

    def measure(self, now_ns: int) -> TareValue:
        """Set the tare to the mean of the latest samples, and return it.

        Parameters
        ----------
        now_ns : int
            Present ROS time [ns].

        Raises
        ------
        TareError
            If the samples cannot be used as a tare. The tare stays as it was.
        """
        with self._lock:
            blocks = self._check(now_ns)
            value = self._compute(blocks, now_ns)
            wrenches = [block.wrench for block in blocks if block.wrench is not None]
            self._wrench_tare = (
                np.concatenate(wrenches)[-value.samples :].mean(axis=0) if wrenches else None
            )
            self._value = value
        return value

    def clear(self, now_ns: int) -> TareValue:
        """Clear the tare, so that nothing is subtracted any more."""
        with self._lock:
            self._wrench_tare = None
            self._value = TareValue(now_ns)
        return self._value

    def note_restart(self, now_ns: int) -> bool:
        """Clear the tare of a device that has restarted; return whether a tare was set."""
        with self._lock:
            self._drop_samples(_BREAKS[StrainStatus.RESTARTED])
        was_set = self._value.samples > 0
        self.clear(now_ns)
        return was_set

    def compute_drift(self, now_ns: int) -> float | None:
        """Return how far the unloaded sensor has drifted from the tare [N].

        The drift is the difference between a new tare and the present one. Return None if no tare
        is set, or if a new tare would be refused now, for example under load.
        """
        if not self._value.samples:
            return None
        with self._lock:
            try:
                value = self._compute(self._check(now_ns), now_ns)
            except TareError:
                return None
        return value.tare_n - self._value.tare_n

    def _drop_samples(self, event: str) -> None:
        """Drop the stored samples, which cannot be used for a tare after ``event``."""
        self._blocks.clear()
        self._samples = 0
        self._break = event

    def _check(self, now_ns: int) -> list[StrainBlock]:
        """Return the stored blocks if there are enough of them and they are recent and valid."""
        blocks, config = list(self._blocks), self._config
        if self._samples < config.tare_samples:
            since = '' if self._break is None else f' since {self._break}'
            raise TareError(
                'few',
                f'only {self._samples} of {config.tare_samples} samples received{since}; leave '
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
                    'marked',
                    f'the latest samples have the status {bad.describe()}; see the diagnostics',
                )
        return blocks

    def _compute(self, blocks: list[StrainBlock], now_ns: int) -> TareValue:
        config = self._config
        tension_n = np.concatenate([block.tension_n for block in blocks])[-config.tare_samples :]
        mean_n, spread_n = float(tension_n.mean()), float(tension_n.std(ddof=1))
        # The drift is the rise of the regression line from the first to the last sample.
        positions = np.linspace(-0.5, 0.5, len(tension_n))
        change_n = float(positions @ (tension_n - mean_n) / (positions @ positions))
        if abs(mean_n) > config.tare_limit_n:
            raise TareError(
                'loaded',
                f'loaded: the mean without any tare is {mean_n:.2f} N, more than tare_limit_n '
                f'({config.tare_limit_n:g} N); slacken the tendon',
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
        return TareValue(now_ns, mean_n, spread_n, len(tension_n))
