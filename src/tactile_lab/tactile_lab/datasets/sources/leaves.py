# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The files and bags that the named paths hold, and the labels that their names give."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
import re

from tactile_lab.datasets.sources.options import SourceOptions
from tactile_lab.datasets.sources.questions import LAYOUT, Questions, SourceError

BAG_SUFFIXES = ('.mcap', '.db3')
_LABEL_FILES = re.compile(r'^(labels?|y|.+_(labels?|y))$')
_NUMBER_AT_END = re.compile(r'[-_ .]*\d*$')
MAX_LEAVES = 100_000
"""Most files in the named folders."""


class Kind(Enum):
    """Kind of recording at a path."""

    ARCHIVE = 'archive'
    ARRAY = 'array'
    TABLE = 'table'
    BAG = 'bag'


_KINDS = {
    '.npz': Kind.ARCHIVE,
    '.npy': Kind.ARRAY,
    **dict.fromkeys(('.csv', '.tsv', '.txt', '.parquet'), Kind.TABLE),
    **dict.fromkeys(BAG_SUFFIXES, Kind.BAG),
}


@dataclass(frozen=True)
class Leaf:
    """One file or bag.

    Attributes
    ----------
    root : Path
        The path that was named, in which it lies.
    """

    path: Path
    root: Path
    kind: Kind

    @property
    def name(self) -> str:
        """The path below the named folder, the folder included."""
        if self.path == self.root:
            return self.path.name
        return f'{self.root.name}/{self.path.relative_to(self.root).as_posix()}'.lstrip('/')

    @property
    def folder(self) -> str:
        """Name of the folder that it lies in."""
        return self.path.absolute().parent.name

    @property
    def word(self) -> str:
        """Name of the file without ending and number."""
        return _NUMBER_AT_END.sub('', self.path.stem)


def find_leaves(paths: Sequence[Path]) -> list[Leaf]:
    """Return the files and bags of the named paths, in the order of names within each.

    Raises
    ------
    SourceError
        When a path does not exist, holds nothing that is known, or too much.
    """
    leaves: list[Leaf] = []
    for path in paths:
        found = list(_walk(path, path))
        if not found:
            what = (
                'there are no recordings in it'
                if path.is_dir()
                else f'files of the kind "{path.suffix}" are not known'
            )
            raise SourceError(f'{path}: {what}\n{LAYOUT}')
        leaves += found
    return leaves


def _walk(path: Path, root: Path) -> Iterator[Leaf]:
    if not path.exists():
        raise SourceError(f'{path} does not exist')
    if path.is_file():
        kind = _KINDS.get(path.suffix.lower())
        if kind is not None:
            yield Leaf(path, root, kind)
        return
    inside = sorted(path.iterdir())
    if len(inside) > MAX_LEAVES:
        raise SourceError(f'{path} holds {len(inside)} files; the limit is {MAX_LEAVES}')
    if any(p.name == 'metadata.yaml' or p.name.endswith(BAG_SUFFIXES) for p in inside):
        yield Leaf(path, root, Kind.BAG)
        return
    for child in inside:
        if not child.name.startswith('.') and not _LABEL_FILES.match(child.stem):
            yield from _walk(child, root)


def name_labels(
    leaves: Sequence[Leaf], options: SourceOptions, questions: Questions
) -> list[dict[str, str]]:
    """Return the label of each file, and what else a pattern finds in its path.

    Raises
    ------
    SourceError
        When the names do not say it and nobody can be asked.
    """
    if options.label:
        questions.note(f'label: "{options.label}" for all, as stated')
        return [{'label': options.label} for _ in leaves]
    pattern = options.compile_label_pattern()
    if pattern is not None:
        return [_match(pattern, leaf) for leaf in leaves]
    how = options.label_from or _how_labelled(leaves, questions)
    if how == 'folder':
        labels = [leaf.folder for leaf in leaves]
        questions.note(f'label: the folder of each file ({_name_some(labels)})')
    else:
        labels = [leaf.word for leaf in leaves]
        questions.note(f'label: the name of each file without its number ({_name_some(labels)})')
    if '' in labels:
        empty = leaves[labels.index('')].name
        raise SourceError(f'{empty} has no name beside its number; --label-from folder or --label')
    outer = [leaf.path.absolute().parent.parent.name for leaf in leaves]
    if how == 'folder' and len(set(outer)) > 1:
        questions.note(f'column folder: the folder around those ({_name_some(outer)})')
        return [{'label': a, 'folder': b} for a, b in zip(labels, outer, strict=True)]
    return [{'label': label} for label in labels]


def _how_labelled(leaves: Sequence[Leaf], questions: Questions) -> str:
    if len({leaf.folder for leaf in leaves}) > 1:
        return 'folder'
    words = {leaf.word for leaf in leaves}
    guess = 'file' if 1 < len(words) < len(leaves) and '' not in words else ''
    first = leaves[0]
    example = f' ({first.path.name} would be {first.word})' if guess else ''
    return questions.choose(
        f'the label of each file is not known{example}',
        ('folder', 'file'),
        '--label-from folder, --label-from file, --label-from PATTERN, or --label NAME',
        guess,
    )


def _match(pattern: re.Pattern[str], leaf: Leaf) -> dict[str, str]:
    # Of a file that is named itself, the folder counts as well.
    path = leaf.name if leaf.path != leaf.root else f'{leaf.folder}/{leaf.path.name}'
    found = pattern.search(path)
    if found is None:
        raise SourceError(f'--label-from: "{pattern.pattern}" is not found in {leaf.name}')
    named = {name: text or '' for name, text in found.groupdict().items()}
    named.setdefault('label', found.group(1) or '')
    if not named['label']:
        raise SourceError(f'--label-from: "{pattern.pattern}" finds an empty label in {leaf.name}')
    return named


def _name_some(names: Sequence[str]) -> str:
    different = list(dict.fromkeys(names))
    return ', '.join(different[:6]) + (' ...' if len(different) > 6 else '')
