# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The executable behind ``tactile``."""

import os

from tactile_ros.process import hold_signals, ignore_signals, share_one_heap


def main() -> int:
    """Run the ``tactile`` command; return its exit code."""
    # Matrices are small, and OpenBLAS's threads would wait for each other. Before NumPy is loaded.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    share_one_heap()
    hold_signals()  # before the imports, so that a signal that comes early is not lost
    from tactile_lab import program

    try:
        return program.main()
    finally:
        ignore_signals()


if __name__ == '__main__':
    raise SystemExit(main())
