# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A device behind a pseudo-terminal, served on a separate thread."""

import os
from pathlib import Path
import select
import tempfile
import threading
import tty


class PtyPeer:
    """Device behind a pseudo-terminal; a subclass defines `take`.

    `take` is called with received bytes when they arrive, and with ``b''`` while none arrive.
    """

    def __init__(self):
        self._folder = tempfile.TemporaryDirectory()
        self.port = str(Path(self._folder.name, 'port'))
        self.plug_in()

    def plug_in(self):
        """Offer a new pseudo-terminal under the same name."""
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.symlink(os.ttyname(self._slave), self.port)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def say(self, data):
        os.write(self._master, data)

    def close(self):
        """Unplug permanently; idempotent."""
        self.unplug()
        self._folder.cleanup()

    def unplug(self):
        master, self._master = self._master, -1
        if master >= 0:
            os.unlink(self.port)
            os.close(self._slave)
            self._thread.join(1.0)
            os.close(master)

    def _serve(self):
        try:
            while self._master >= 0:
                ready, _, _ = select.select([self._master], [], [], 0.003)
                self.take(os.read(self._master, 1024) if ready else b'')
        except (OSError, ValueError):
            pass
