# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The executable ``tactile``."""

import os

from tactile_ros.process import hold_signals, ignore_signals, share_one_heap


def main() -> int:
    """Run the ``tactile`` command; return its exit code."""
    # Must be set before NumPy is imported. Our matrices are too small for several threads.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    share_one_heap()
    hold_signals()  # before the imports, so that no early signal is lost
    from tactile_lab import program

    try:
        return program.main()
    finally:
        ignore_signals()


if __name__ == '__main__':
    raise SystemExit(main())
