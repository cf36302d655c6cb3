# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults of the serial line between a device and its driver."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
import random

NOISE_PERIOD_S = 0.01
MOST_GARBAGE_BYTES = 12

Splitter = Callable[[bytes], Sequence[bytes]]
"""Cuts what a device says into its records: lines or packets."""


class LineFault:
    """A fault while it lasts; this one does nothing to the bytes.

    Parameters
    ----------
    on_end
        Called when the fault is over.

    Attributes
    ----------
    is_spent
        Whether it is over by itself, before its time.
    """

    def __init__(self, on_end: Callable[[], None] = lambda: None) -> None:
        self._on_end = on_end
        self.is_spent = False

    def say(self, data: bytes, now_s: float) -> bytes:
        """Return the bytes that reach the driver from the device; called in every step."""
        return data

    def hear(self, data: bytes) -> bytes:
        """Return the bytes that reach the device from the driver."""
        return data

    def end(self) -> bytes:
        """End the fault and return what it has held back."""
        self._on_end()
        return b''


class Cut(LineFault):
    """A wire is broken: what the device says is lost, what it would hear, or both.

    Parameters
    ----------
    says, hears
        Whether the device still does.
    on_end
        See `LineFault`.
    """

    def __init__(self, says: bool, hears: bool, on_end: Callable[[], None] = lambda: None) -> None:
        super().__init__(on_end)
        self._says, self._hears = says, hears

    def say(self, data: bytes, now_s: float) -> bytes:
        return data if self._says else b''

    def hear(self, data: bytes) -> bytes:
        return data if self._hears else b''


class Burst(LineFault):
    """Bytes wait in an adapter and come in clumps.

    Parameters
    ----------
    period_s
        Time between two clumps [s].
    """

    def __init__(self, period_s: float) -> None:
        super().__init__()
        self._period_s = period_s
        self._clump = -math.inf
        self._held = bytearray()

    def say(self, data: bytes, now_s: float) -> bytes:
        self._held += data
        clump = now_s // self._period_s
        if clump == self._clump:
            return b''
        self._clump = clump
        return self._take()

    def end(self) -> bytes:
        super().end()
        return self._take()

    def _take(self) -> bytes:
        taken, self._held = bytes(self._held), bytearray()
        return taken


class Drop(LineFault):
    """Whole records are lost.

    Parameters
    ----------
    split
    count
        How many; infinity: all while it lasts.
    is_wanted
        Which records can be lost.
    """

    def __init__(self, split: Splitter, count: float, is_wanted: Callable[[bytes], bool]) -> None:
        super().__init__()
        self._split, self._left, self._is_wanted = split, count, is_wanted

    def say(self, data: bytes, now_s: float) -> bytes:
        kept = bytearray()
        for record in self._split(data):
            if self._left > 0 and self._is_wanted(record):
                self._left -= 1
            else:
                kept += record
        self.is_spent = self._left <= 0
        return bytes(kept)


class _Spoiler(LineFault):
    """Something happens to a share of the records."""

    def __init__(self, split: Splitter, share: float, chance: random.Random) -> None:
        super().__init__()
        self._split, self._share, self._chance = split, share, chance

    def say(self, data: bytes, now_s: float) -> bytes:
        return b''.join(
            self._spoil(record) if self._chance.random() < self._share else record
            for record in self._split(data)
        )

    def _spoil(self, record: bytes) -> bytes:
        raise NotImplementedError


class Garbage(_Spoiler):
    """Random bytes come before a record."""

    def _spoil(self, record: bytes) -> bytes:
        return self._chance.randbytes(self._chance.randint(1, MOST_GARBAGE_BYTES)) + record


class Split(_Spoiler):
    """The end of a record is lost, with its line end: it melts into the next one."""

    def _spoil(self, record: bytes) -> bytes:
        return record[: self._chance.randrange(len(record))]


class Corrupt(_Spoiler):
    """One bit of a record flips."""

    def _spoil(self, record: bytes) -> bytes:
        spoilt = bytearray(record)
        spoilt[self._chance.randrange(len(spoilt))] ^= 1 << self._chance.randrange(8)
        return bytes(spoilt)


class Noise(LineFault):
    """Half packets arrive without a request.

    Parameters
    ----------
    packet
        A whole packet, of which beginnings are heard.
    chance
    """

    def __init__(self, packet: bytes, chance: random.Random) -> None:
        super().__init__()
        self._packet, self._chance = packet, chance
        self._due_s = -math.inf

    def say(self, data: bytes, now_s: float) -> bytes:
        if now_s < self._due_s:
            return data
        self._due_s = now_s + NOISE_PERIOD_S
        return self._packet[: self._chance.randrange(1, len(self._packet))] + data


class WrongBaud(LineFault):
    """Device and driver have different speeds.

    Parameters
    ----------
    ratio
        The device's speed over the driver's.
    """

    def __init__(self, ratio: float) -> None:
        super().__init__()
        self._ratio = ratio

    def say(self, data: bytes, now_s: float) -> bytes:
        return resample_uart(data, self._ratio)

    def hear(self, data: bytes) -> bytes:
        return resample_uart(data, 1 / self._ratio)


def resample_uart(data: bytes, ratio: float) -> bytes:
    """Return what a receiver of another speed makes of bytes sent back to back, 8N1.

    A byte whose stop bit is missing is read as 0, as Linux does by default.

    Parameters
    ----------
    data
        What is sent.
    ratio
        The sender's speed over the receiver's; with 1 the bytes come through.
    """
    bits = [bit for byte in data for bit in (0, *(byte >> i & 1 for i in range(8)), 1)]

    def level(time: float) -> int:  # in the sender's bits; the line idles high
        return bits[int(time)] if time < len(bits) else 1

    heard = bytearray()
    time = 0.0
    while time < len(bits):
        if level(time):
            time = math.floor(time) + 1.0
            continue
        *byte, stop = (level(time + (i + 0.5) * ratio) for i in range(1, 10))
        heard.append(sum(bit << i for i, bit in enumerate(byte)) if stop else 0)
        time += 9.5 * ratio
        while not level(time):  # a start bit needs an idle line before it
            time = math.floor(time) + 1.0
    return bytes(heard)
