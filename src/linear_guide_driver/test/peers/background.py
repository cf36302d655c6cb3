# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Blocking calls beside a test, and waiting for what they lead to."""

import threading


class Background:
    """Runs a call on a thread and keeps how it ended."""

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
        """Check that it ends by an error of this kind that says these words."""
        error = self.end()
        assert isinstance(error, kind)
        assert words in str(error)
