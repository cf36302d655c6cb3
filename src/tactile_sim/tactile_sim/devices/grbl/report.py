# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Grbl's status report, with the fields that come only now and then."""

from __future__ import annotations

_OFFSET_EVERY = {True: 30, False: 10}
_OVERRIDES_EVERY = {True: 20, False: 10}


class StatusReporter:
    """Counts the reports: work offset and overrides are in some of them."""

    def __init__(self) -> None:
        self._offset_countdown = 0
        self._overrides_countdown = 0

    def encode(
        self, state: str, mpos_mm: float, velocity_mm_s: float, free: tuple[int, int], mask: int
    ) -> bytes:
        """One report.

        Parameters
        ----------
        state
            For example ``Idle`` or ``Hold:0``.
        free
            Free planner blocks and free bytes of the receive buffer.
        mask
            Setting 10: 1 machine instead of work position, 2 adds the buffers.
        """
        fields = [state, f'{"MPos" if mask & 1 else "WPos"}:{mpos_mm:.3f},0.000,0.000']
        if mask & 2:
            fields.append(f'Bf:{free[0]},{free[1]}')
        fields.append(f'FS:{abs(velocity_mm_s) * 60:.0f},0')
        busy = state.split(':')[0] in ('Run', 'Hold')
        if self._offset_countdown > 0:
            self._offset_countdown -= 1
        else:
            self._offset_countdown = _OFFSET_EVERY[busy] - 1
            self._overrides_countdown = max(self._overrides_countdown, 1)
            fields.append('WCO:0.000,0.000,0.000')
        if self._overrides_countdown > 0:
            self._overrides_countdown -= 1
        else:
            self._overrides_countdown = _OVERRIDES_EVERY[busy] - 1
            fields.append('Ov:100,100,100')
        return f'<{"|".join(fields)}>\r\n'.encode()
