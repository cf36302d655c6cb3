# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Blocking calls that a test executes on a separate thread."""

import threading

from tactile_testing.waiting import wait_until


class Background:
    """Runs a call on a thread, and stores its result or exception."""

    def __init__(self, call, *arguments):
        self.error = None
        self._thread = threading.Thread(target=self._run, args=(call, *arguments))
        self._thread.start()

    def _run(self, call, *arguments):
        try:
            call(*arguments)
        except Exception as error:
            self.error = error

    def end(self):
        self._thread.join(8.0)
        assert not self._thread.is_alive()
        return self.error

    def ends_by(self, kind, words=''):
        """Check that the call raises an error of this kind, with these words in its message."""
        error = self.end()
        assert isinstance(error, kind)
        assert words in str(error)


def begin_pull(tendon, servo, *arguments):
    """Start a pull by 20 mm on a thread, and return it while it runs."""
    pull = Background(tendon.pull_to, 0.02, 0.01, *arguments)
    wait_until(lambda: servo.position > 2100)
    return pull
