# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writing of files so that they are complete after a crash or a loss of power."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


def replace_file(path: Path, data: bytes) -> None:
    """Replace a file atomically, and return when it is on the disk.

    A crash can leave the unfinished file ``.NAME.PID.new`` in the folder.

    Raises
    ------
    OSError
        If the file cannot be written. The previous file is then unchanged, except if only the
        entry in the folder could not be written to the disk.
    """
    temporary = path.with_name(f'.{path.name}.{os.getpid()}.new')
    try:
        with temporary.open('wb') as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Wait until the directory entries of a folder are on the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
