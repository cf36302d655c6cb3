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

"""The program behind ``tactile``."""

import os

from tactile_ros.programs.memory import share_one_heap
from tactile_ros.programs.signals import hold_signals, ignore_signals


def main() -> int:
    """Run the ``tactile`` command; return its exit code."""
    # Matrices are small, and OpenBLAS's threads would wait for each other. Before NumPy is loaded.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    share_one_heap()
    hold_signals()  # before the imports, so that a signal that comes early is not lost
    from tactile_lab.cli import main as cli

    try:
        return cli.main()
    finally:
        ignore_signals()
