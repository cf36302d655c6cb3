# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A pseudo-terminal under a name that stays, as udev's names do."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
import tty

from tactile_sim.errors import RigError

_READ_BYTES = 4096


class PtyPort:
    """The device's end of a line; drivers open ``link``.

    The pty's own name is not for them: the kernel gives its number to the next one who asks,
    as soon as this one is unplugged.

    Parameters
    ----------
    link
        Where to put the symbolic link.

    Raises
    ------
    RigError
        Something else is there.
    """

    def __init__(self, link: Path) -> None:
        self._link = link
        self._files: list[int] = []
        if link.exists() and not link.is_symlink():
            raise RigError(f'{link} exists and is no symbolic link; choose another --links')
        self.open()

    @property
    def is_open(self) -> bool:
        """True while the port is plugged in."""
        return bool(self._files)

    def fileno(self) -> int:
        """Descriptor of the device's end."""
        return self._files[0]

    def open(self) -> None:
        """Make a pty and its link."""
        master, slave = os.openpty()
        # The spare slave stays open, or reading the master fails when a client closes.
        self._files = [master, slave]
        tty.setraw(slave)
        os.set_blocking(master, False)
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(os.ttyname(slave))

    def close(self) -> None:
        """Take the pty and its link away; harmless when called twice."""
        if self._files:
            self._link.unlink(missing_ok=True)
        while self._files:
            os.close(self._files.pop())

    def read(self) -> bytes:
        """Return what the driver has sent; only when there is something."""
        return os.read(self.fileno(), _READ_BYTES)

    def write(self, data: bytes) -> None:
        """Send to the driver. A full pty loses bytes, as a line without handshake does."""
        with contextlib.suppress(BlockingIOError):
            os.write(self.fileno(), data)
