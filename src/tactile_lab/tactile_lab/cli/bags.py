# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arguments and help of the commands on bags; the work is in `tactile_lab.commands`.

Ubuntu 24.04 has Typer 0.9, which refuses ``X | None`` and does not look into annotations
that are strings: so ``Optional[X]``, and no ``from __future__ import annotations`` here.
"""

from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.options import check_paths, JsonOption, refusals, WatchOption


def replay(
    bag: Annotated[Path, typer.Argument(help='The recording.')],
    models: Annotated[
        Optional[Path],
        typer.Option(help='Folder with the model files. Default: where the recording found them.'),
    ] = None,
    nodes: Annotated[
        bool, typer.Option(help='Send the bag through real nodes as well as the plain core.')
    ] = True,
    times: Annotated[
        int, typer.Option(min=1, max=100_000, help='How often; ends at the first difference.')
    ] = 1,
    watch: WatchOption = False,
    json_output: JsonOption = False,
) -> None:
    """Run a recording through features and classification again, and compare.

    Prints *equal*, or the first difference from what was recorded; exits with 1 when
    there is one. Then says whether samples of the recording are missing, doubled or out of
    order. With ``--watch`` it first plays the recording in real time on a live page.
    """
    with refusals():
        check_paths(bag, models)
        from tactile_lab.commands.replay import play_and_watch, run_replay
        from tactile_lab.watch.options import WatchOptions

        if watch:
            play_and_watch(bag, models, WatchOptions(), as_json=json_output)
        equal = run_replay(bag, models, through_nodes=nodes, times=times, as_json=json_output)
    raise typer.Exit(0 if equal else 1)


def repair(
    bag: Annotated[Path, typer.Argument(help='The bag that was never closed.')],
    output: Annotated[
        Path, typer.Option('--output', '-o', help='Folder of the copy; must not exist yet.')
    ],
    json_output: JsonOption = False,
) -> None:
    """Write a closed copy of a bag whose recorder was killed.

    Every other command reads such a bag as it is, and says so. Other programs may need the index
    at the end of the copy. The copy holds the same messages, byte for byte, and names its source.
    The bag itself is not changed. Exits with 1 when the bag is
    damaged in its middle: the copy ends there.
    """
    with refusals():
        check_paths(bag)
        from tactile_lab.commands.repair import run_repair

        whole = run_repair(bag, output, as_json=json_output)
    raise typer.Exit(0 if whole else 1)


def show(
    path: Annotated[
        Path, typer.Argument(help='A bag, a model file (.onnx) or an archive (.npz).')
    ],
    plot: Annotated[
        Optional[Path],
        typer.Option(metavar='FILE', help='Draw one trial into this file: .png, .svg or .pdf.'),
    ] = None,
    trial: Annotated[int, typer.Option(min=1, help='Which trial to draw, from 1.')] = 1,
    json_output: JsonOption = False,
) -> None:
    """List the contents of a recording, a model file or an archive.

    For a bag or an archive: its trials with label, session and length. For a model: its inputs,
    training trials, accuracy on held-out trials, calibration error and limits.
    """
    with refusals():
        from tactile_lab.commands.show import run_show

        run_show(path, plot, trial, as_json=json_output)
