# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Provenance of a report: digests and facts of the recordings, software versions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import hashlib
import importlib.metadata
from pathlib import Path
import platform
from typing import Any

from tactile_bags.recording import Recording

LIBRARIES = ('tactile_classifier', 'numpy', 'scipy', 'scikit-learn', 'matplotlib')


@dataclass(frozen=True)
class Source:
    """One recording.

    Attributes
    ----------
    name : str
        Of the file or folder, without where it lies.
    sha256 : str
        Of the file, of the files of a folder by name, or of the data files of a bag.
    facts : dict
        What the recording says of itself, such as seed and simulator.
    """

    name: str
    sha256: str
    facts: dict[str, Any]


def describe_sources(paths: Sequence[Path], recording: Recording) -> list[Source]:
    """Return name, digest and facts of each bag of ours, or else of each named path.

    Parameters
    ----------
    paths : sequence of Path
        As they were named; a folder of files is one.
    recording : Recording
        Of these, open.
    """
    if not recording.is_own:
        return [Source(path.resolve().name, _compute_digest(path), {}) for path in paths]
    return [
        Source(
            bag.path.resolve().name,
            bag.sha256(),
            {k: v for k, v in bag.metadata.items() if not isinstance(v, (dict, list))},
        )
        for bag in recording.bags
    ]


def _compute_digest(path: Path) -> str:
    """Return the SHA-256 of a file, or of all files of a folder in the order of their names."""
    digest = hashlib.sha256()
    files = sorted(p for p in path.rglob('*') if p.is_file()) if path.is_dir() else [path]
    for file in files:
        with file.open('rb') as stream:
            while block := stream.read(2**20):
                digest.update(block)
    return digest.hexdigest()


def find_versions() -> dict[str, str]:
    """Return the versions of Python and the libraries that the numbers depend on."""
    found = {name: _version(name) for name in LIBRARIES}
    return {'python': platform.python_version(), **{k: v for k, v in found.items() if v}}


def _version(library: str) -> str:
    try:
        return importlib.metadata.version(library)
    except importlib.metadata.PackageNotFoundError:
        return ''
