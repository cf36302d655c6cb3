# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
