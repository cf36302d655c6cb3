# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Keeps a tension on a thread of its own, for as long as its goal is in force."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import threading
import time

from linear_guide_driver.dynamixel.servo_monitor import ServoMonitor
from linear_guide_driver.dynamixel.tension_control import TensionController
from linear_guide_driver.errors import LinearGuideDriverError

POLL_WAIT_S = 1.0

SILENT = 'No valid strain sample arrives: the tension is not kept any more, the tendon is held.'


class TensionKeeper:
    """One step of the controller with each state of the servo.

    Parameters
    ----------
    read_tension : callable
        Returns the present tension [N]; None when no valid sample arrives.
    follow : callable
        Takes where the tendon shall be [m]; returns False when a later command is in force.
    hold : callable
        Holds the tendon where it is, unless a later command is in force.
    on_end : callable
        Called with a reason when the keeping ends without a command.

    Attributes
    ----------
    end : str
        Why the keeping has ended without a command; empty while it goes on.
    """

    def __init__(
        self,
        controller: TensionController,
        monitor: ServoMonitor,
        read_tension: Callable[[], float | None],
        follow: Callable[[float], bool],
        hold: Callable[[], None],
        on_end: Callable[[str], None],
    ) -> None:
        self.controller = controller
        self.end = ''
        self._monitor, self._read_tension = monitor, read_tension
        self._follow, self._hold, self._on_end = follow, hold, on_end
        self._thread = threading.Thread(target=self._run, name='tension keeper', daemon=True)

    def start(self) -> None:
        """Start to keep the tension."""
        self._thread.start()

    def _run(self) -> None:
        stepped_s = time.monotonic()
        try:
            while True:
                state = self._monitor.wait_poll(POLL_WAIT_S)
                if state is None and self._monitor.is_reading:
                    continue  # this computer was busy, or asleep; a later command is seen below
                if state is None:  # a fault, which the servo's own watchdog or the poll has seen
                    return
                tension_n = self._read_tension()
                if tension_n is None:
                    self._hold()
                    self.end = SILENT
                    self._on_end(SILENT)
                    return
                now_s = time.monotonic()
                goal_m = self.controller.step(state.displacement_m, tension_n, now_s - stepped_s)
                stepped_s = now_s
                if not self._follow(goal_m):
                    return
        except LinearGuideDriverError as error:
            self._monitor.fail(str(error))
        except BaseException:  # a fault of the functions that were given: nobody watches now
            with suppress(LinearGuideDriverError):
                self._hold()
            raise
