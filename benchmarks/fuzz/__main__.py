# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Run the fuzzers of all parsers, or of those that are named."""

from __future__ import annotations

import argparse
from collections.abc import Callable
import random
import sys
import time
import tracemalloc

from benchmarks.fuzz import ati, parsers
from benchmarks.fuzz.rules import FuzzError, STREAM_RECORDS

MEMORY_BOUND_BYTES = 200_000

FUZZERS = parsers.FUZZERS | ati.FUZZERS

DESCRIPTION = """Feed generated inputs to the parsers and check what comes out.

An input is one record (a load-cell line, a line of Grbl, a Dynamixel packet, an RDT
datagram), whole or damaged: bits flipped, bytes lost, doubled or put in, cut short, or
noise altogether. Twenty of them make a stream, which is cut into chunks at random. What a
parser finds must stand in the stream, by a second and plainer reading of it; after the
damage whole records must be found again; and memory must not grow.
"""

EPILOG = """exit status:
  0 when every parser held, 1 when one did not, 2 for a wrong argument.

examples:
  ./tactile run python -m benchmarks.fuzz --inputs 20000
  ./tactile run python -m benchmarks.fuzz --inputs 1000000 --only lines
"""


def measure_growth(fuzzer: Callable[[random.Random, int], int], inputs: int) -> int:
    """Return by how much the memory in use grows while inputs are parsed [bytes]."""
    fuzzer(random.Random(0), STREAM_RECORDS)  # what is built once
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    fuzzer(random.Random(1), inputs)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak - before


def main(arguments: list[str] | None = None) -> int:
    """Run the fuzzers that the arguments name."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.fuzz',
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument('--inputs', type=int, default=20_000, help='records for each parser')
    parser.add_argument('--seed', type=int, default=1, help='another seed, other inputs')
    parser.add_argument(
        '--only',
        metavar='NAME',
        action='append',
        choices=FUZZERS,
        help='this parser alone; may be given again for another',
    )
    options = parser.parse_args(arguments)
    held = True
    for name in options.only or FUZZERS:
        start_s = time.perf_counter()
        try:
            found = FUZZERS[name](random.Random(options.seed), options.inputs)
            growth_bytes = measure_growth(FUZZERS[name], min(options.inputs, 20_000))
            if growth_bytes > MEMORY_BOUND_BYTES:
                raise FuzzError(f'memory grows by {growth_bytes} bytes')
        except FuzzError as error:
            held = False
            sys.stdout.write(f'{name}: {error}\n')
            continue
        sys.stdout.write(
            f'{name}: {options.inputs} inputs, {found} found, none invented, memory within '
            f'{growth_bytes / 1000:.0f} kB, {time.perf_counter() - start_s:.0f} s\n'
        )
    return 0 if held else 1


if __name__ == '__main__':
    sys.exit(main())
