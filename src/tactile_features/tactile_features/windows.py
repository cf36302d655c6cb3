# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Buffer of the latest samples in the order of their sequence numbers, with known gaps."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_ros.strain import StrainBlock, StrainStatus

SAMPLE = np.dtype(
    [
        ('stamp_ns', np.int64),
        ('latest_ns', np.int64),
        ('sequence', np.uint64),
        ('tension_n', np.float64),
        ('status', np.uint32),
        ('stamp_error_s', np.float64),
        ('step_ns', np.int64),
        ('hole', np.bool_),
        ('interpolated', np.bool_),
    ]
)
"""One sample. ``latest_ns`` is the running maximum of the stamps, for binary search.
``stamp_error_s`` is a bound on the error of the stamp; negative if unknown. ``step_ns`` is the
step of the host's clock between the previous sample and this one. ``hole`` is True if samples are
missing between the previous sample and this one, the samples paused, or the clock was stepped."""

_LARGEST_STEP_NS = 1 << 62

_CLOCK_STEP = int(StrainStatus.CLOCK_STEP)
_SIMULATED = int(StrainStatus.SIMULATED)
_RESYNCHRONISED = int(StrainStatus.RESYNCHRONISED)
_BREAKS = _CLOCK_STEP | int(StrainStatus.RECONNECTED)
"""Status bits: a block with one of these bits does not continue the previous block."""
_EVENTS = _BREAKS | _RESYNCHRONISED

SET_BACK_NS = 1_000_000_000
"""If the stamps go back by more than this at a new block, the clock was set back [ns]."""

PAUSE_NS = 500_000_000
"""If the stamps jump by more than this at a resynchronised block, in addition to the time that
its sequence numbers explain, the samples have paused [ns]."""

Samples = NDArray[Any]
"""An array of `SAMPLE`."""


class SampleBuffer:
    """Buffer of samples. Its contents do not depend on how samples are grouped into blocks.

    - If a block repeats sequence numbers and stamps, it is late or a duplicate, and the repeated
      samples are dropped. If only the sequence numbers repeat, the driver was restarted.
    - If at most ``max_gap_samples`` consecutive samples are lost, they are interpolated linearly.
      If more are lost, the gap is marked as a hole. A restart, a step of the host's clock and a
      reconnection are also marked as holes; after a reconnection, the number of lost samples is
      unknown.
    - The memory is bounded: a sample is kept for ``buffer_ns``, measured by the stamps, and the
      buffer keeps at most ``capacity`` samples.

    Attributes
    ----------
    late_sample_count, restart_count : int
        Number of repeated samples that were dropped; number of restarts of the stream and of
        backward steps of its clock.
    new_count : int
        Number of samples that the last `add` appended, including interpolated ones.
    evicted_ns : int or None
        Stamp of the latest sample that was removed from the buffer [ns].
    watermark_ns : int or None
        Latest stamp seen [ns]; None before the first sample.
    """

    def __init__(self, buffer_ns: int, capacity: int, max_gap_samples: int) -> None:
        self._buffer_ns = buffer_ns
        self._capacity = capacity
        self._max_gap_samples = max_gap_samples
        self.late_sample_count = 0
        self.new_count = 0
        self.restart_count = 0
        self._clear()

    def _clear(self) -> None:
        self._store(np.empty(1024, SAMPLE))
        self._start = self._end = 0
        self.evicted_ns: int | None = None
        self.watermark_ns: int | None = None
        self._next_sequence = 0
        self._last_status = 0

    @property
    def samples(self) -> Samples:
        """All samples as an array of `SAMPLE`; valid until the next `add`."""
        return self._data[self._start : self._end]

    @property
    def new_samples(self) -> Samples:
        """Samples appended by the last `add`, an array of `SAMPLE`; valid until the next `add`."""
        return self._data[self._end - self.new_count : self._end]

    @property
    def new_step_ns(self) -> int:
        """Step of the host's clock before the samples that the last `add` appended [ns]."""
        return int(self._columns['step_ns'][self._end - self.new_count]) if self.new_count else 0

    @property
    def is_simulated(self) -> bool:
        """True if the newest sample is from a simulated sensor."""
        return bool(self._last_status & _SIMULATED)

    def first_at(self, stamp_ns: int) -> int:
        """Return the index of the first sample whose stamp is not earlier than ``stamp_ns``."""
        return (
            bisect_left(self._columns['latest_ns'], stamp_ns, self._start, self._end) - self._start
        )

    def first_beyond(self, stamp_ns: int) -> int:
        """Return the index of the first sample whose stamp is later than ``stamp_ns``."""
        return (
            bisect_right(self._columns['latest_ns'], stamp_ns, self._start, self._end)
            - self._start
        )

    def add(self, block: StrainBlock) -> bool:
        """Append a block.

        If the clock was set back, remove all earlier samples and return True.
        """
        self.new_count = 0
        count = len(block.tension_n)
        if count == 0:
            return False
        if (
            self.watermark_ns is not None
            and block.stamp_ns > self.watermark_ns
            and block.sequence == self._next_sequence
            and not block.lost_before
            and block.period_ns >= 0
            and not int(block.status) & ~self._last_status & _EVENTS
        ):
            self._append_next(block, count)
            return False
        new = _unpack(block)
        if self.watermark_ns is None:
            new['hole'][0] = True
            self._append(new)
            return False
        last = self._data[self._end - 1]
        if new['stamp_ns'][-1] < last['latest_ns'] - SET_BACK_NS:
            step_ns = _measure_step(last, new[0], block.period_ns)
            self._clear()
            self.restart_count += 1
            self.add(block)
            self.new_samples['step_ns'][0] = step_ns
            return True
        fresh = (new['sequence'] > last['sequence']) | (new['stamp_ns'] > last['stamp_ns'])
        repeated = int(fresh.argmax()) if fresh.any() else len(new)
        self.late_sample_count += repeated
        new = new[repeated:]
        if len(new):
            lost_before = 0 if repeated else block.lost_before
            new['step_ns'][0] = _measure_step(last, new[0], block.period_ns)
            self._join(last, new, lost_before, block.period_ns)
            self._append(new)
        return False

    def _append_next(self, block: StrainBlock, count: int) -> None:
        """Append a block that continues the last one. Faster than `_unpack` and `_append`."""
        if self._end + count > len(self._data):
            self._make_room(count)
        self.new_count += count
        self.watermark_ns = block.stamp_ns + (count - 1) * block.period_ns
        self._next_sequence = block.sequence + count
        self._last_status = int(block.status)
        if count == 1:  # faster than writing nine columns
            self._data[self._end] = (
                block.stamp_ns,
                block.stamp_ns,
                block.sequence,
                block.tension_n[0],
                self._last_status,
                _known_error(block),
                0,
                False,
                False,
            )
            self._end += 1
            return
        _write(block, self._columns, slice(self._end, self._end + count))
        self._end += count

    def _join(self, last: Any, new: Samples, lost_before: int, period_ns: int) -> None:
        """Interpolate the gap between the last sample and the new ones, or mark it as a hole."""
        lost = int(new['sequence'][0]) - int(last['sequence']) - 1
        if lost < 0:
            self.restart_count += 1
        first = new[0]
        broken = first['status'] & ~last['status'] & _BREAKS or _has_paused(last, first, period_ns)
        if lost < lost_before or broken or lost > self._max_gap_samples:
            new['hole'][0] = True
        elif lost > 0:
            self._append(_interpolate(last, new[0], lost))

    def evict(self) -> None:
        """Remove samples that are too old, and the oldest ones if the buffer is full."""
        watermark_ns = self.watermark_ns
        if watermark_ns is None:
            return
        start = self._start
        if self._columns['latest_ns'][start] < watermark_ns - self._buffer_ns:
            start += self.first_at(watermark_ns - self._buffer_ns)
        if self._end - start > self._capacity:
            start = self._end - self._capacity
        if start > self._start:
            self._start = start
            self.evicted_ns = int(self._data['latest_ns'][start - 1])

    def _append(self, new: Samples) -> None:
        latest_ns = np.maximum.accumulate(new['stamp_ns'])
        if self.watermark_ns is not None:
            latest_ns = np.maximum(latest_ns, self.watermark_ns)
        new['latest_ns'] = latest_ns
        if self._end + len(new) > len(self._data):
            self._make_room(len(new))
        self._data[self._end : self._end + len(new)] = new
        self._end += len(new)
        self.new_count += len(new)
        self.watermark_ns = int(latest_ns[-1])
        self._next_sequence = int(new['sequence'][-1]) + 1
        self._last_status = int(new['status'][-1])

    def _make_room(self, count: int) -> None:
        kept = self.samples
        self._store(np.empty(2 * (len(kept) + count), SAMPLE))
        self._data[: len(kept)] = kept
        self._start, self._end = 0, len(kept)

    def _store(self, data: Samples) -> None:
        self._data = data
        self._columns = _columns_of(data)


def _columns_of(data: Samples) -> dict[str, NDArray[Any]]:
    """Return the fields of samples by name, which saves time if there are many small blocks."""
    return {name: data[name] for name in SAMPLE.names or ()}


def _unpack(block: StrainBlock) -> Samples:
    new = np.empty(len(block.tension_n), SAMPLE)
    _write(block, _columns_of(new), slice(None))
    return new


def _write(block: StrainBlock, columns: dict[str, NDArray[Any]], to: slice) -> None:
    """Write the samples of a block to a part of the columns; they have no holes or steps."""
    step = np.arange(len(block.tension_n))
    stamp_ns = block.stamp_ns + step * block.period_ns
    columns['stamp_ns'][to] = columns['latest_ns'][to] = stamp_ns
    columns['sequence'][to] = np.uint64(block.sequence) + step.astype(np.uint64)
    columns['tension_n'][to] = block.tension_n
    columns['status'][to] = int(block.status)
    columns['stamp_error_s'][to] = _known_error(block)
    columns['step_ns'][to] = 0
    columns['hole'][to] = columns['interpolated'][to] = False


def _known_error(block: StrainBlock) -> float:
    """Return the bound on the stamp error of a block [s], or -1 if it is unknown."""
    return block.stamp_error_s if block.stamp_error_s >= 0.0 else -1.0


def _measure_step(last: Any, first: Any, period_ns: int) -> int:
    """Return the step of the host's clock between two samples [ns], or 0 if there is none."""
    if not first['status'] & ~last['status'] & _CLOCK_STEP:
        return 0
    periods = max(1, int(first['sequence']) - int(last['sequence']))
    elapsed_ns = int(first['stamp_ns']) - int(last['stamp_ns'])
    step_ns = elapsed_ns - periods * period_ns or 1
    return max(-_LARGEST_STEP_NS, min(_LARGEST_STEP_NS, step_ns))


def _has_paused(last: Any, first: Any, period_ns: int) -> bool:
    """Return True if stamps jump after a sample although the host's clock was not set."""
    if not first['status'] & ~last['status'] & _RESYNCHRONISED:
        return False
    periods = int(first['sequence']) - int(last['sequence'])
    elapsed_ns = int(first['stamp_ns']) - int(last['stamp_ns'])
    return elapsed_ns - periods * period_ns > PAUSE_NS


def _interpolate(before: Any, after: Any, count: int) -> Samples:
    """Return ``count`` evenly spaced samples between two samples."""
    step = np.arange(1, count + 1)
    stamp_ns = int(before['stamp_ns'])
    span_ns = int(after['stamp_ns']) - stamp_ns
    filled = np.zeros(count, SAMPLE)
    filled['stamp_ns'] = stamp_ns + span_ns * step // (count + 1)
    filled['sequence'] = before['sequence'] + step.astype(np.uint64)
    with np.errstate(invalid='ignore', over='ignore'):
        rise = after['tension_n'] - before['tension_n']
        filled['tension_n'] = before['tension_n'] + rise * (step / (count + 1))
    filled['status'] = before['status'] | after['status']
    errors_s = (before['stamp_error_s'], after['stamp_error_s'])
    filled['stamp_error_s'] = max(errors_s) if min(errors_s) >= 0.0 else -1.0
    filled['interpolated'] = True
    return filled
