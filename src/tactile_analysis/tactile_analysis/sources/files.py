# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Search for files and bags in given paths, and labels from the names of files and folders."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
import re

from tactile_analysis.options import SourceError, SourceOptions
from tactile_bags.experiment_journal import BAGS, is_experiment
from tactile_features.model_container import is_model_file

LAYOUT = """recordings can be, all with their sample rate or with times:
  R1/01.csv, R1/02.csv, C1/01.csv ...   one file per trial, in folders named like the label
  one CSV or Parquet table              columns trial, label, time_s, and one per channel
  x.npy and x_labels.npy, or one .npz   numbers (trials, samples), and one label per trial
  R1/bag_1, C1/bag_2 ...                one bag per trial, with --topic and --field
  bags of this package                  with strain and trial events
  recordings.txt                        a list with one of these paths per line"""


@dataclass
class ImportNotes:
    """Sentences about assumptions that were made when recordings were read.

    ``no_label`` is the error about missing labels, with its remedy; None if all trials have
    labels. ``rate_from_stamps`` is True if a sample rate was computed from time stamps.
    """

    lines: list[str] = field(default_factory=list)
    no_label: SourceError | None = None
    rate_from_stamps: bool = False

    def add(self, sentence: str) -> None:
        """Add a sentence, unless it was added before."""
        if sentence not in self.lines:
            self.lines.append(sentence)


def ambiguity(
    sentence: str,
    choices: Sequence[str],
    option: str,
    likely: str = '',
    *,
    with_layout: bool = True,
) -> SourceError:
    """Return the error for a recording about which the user must state something.

    ``sentence`` has no full stop. ``option`` is the command-line option with which the user states
    it, with its value.
    """
    offered = f': {", ".join(choices[:12])}' if choices else ''
    guess = f'; probably {likely}' if likely else ''
    layout = f'\n{LAYOUT}' if with_layout else ''
    return SourceError(f'{sentence}{offered}. State it with {option}{guess}{layout}')


GROUP_WORDS = (
    'session', 'day', 'date', 'subject', 'participant', 'specimen', 'mounting', 'batch', 'run',
    'block', 'folder',
)  # fmt: skip
"""Words in names of columns or folders that mean groups of trials to hold out in an evaluation.

The most likely word is first."""

_NUMBERING = ('id', 'no', 'nr', 'number', 'name')
_WORDS = re.compile(r'[A-Z]+(?![a-z])|[A-Z]?[a-z]+')
_DATE = re.compile(r'\d{4}[-_.]?\d\d[-_.]?\d\d')


def find_group_word(name: str) -> str:
    """Return the word of `GROUP_WORDS` in the name of a column or folder; empty if none.

    ``subject``, ``Subject ID``, ``sessionNumber``, ``day_2`` and ``2026-11-28`` contain such a
    word. ``session_length`` does not count, because it is not the name of a group.
    """
    if _DATE.fullmatch(name):
        return 'date'
    words = [word.lower() for word in _WORDS.findall(name)]
    first = words[0] if words else ''
    is_group = first in GROUP_WORDS and all(word in _NUMBERING for word in words[1:])
    return first if is_group else ''


BAG_SUFFIXES = ('.mcap', '.db3')
MAX_LIST_BYTES = 2**20
"""Largest file with a list of recordings [byte]."""

_LABEL_FILES = re.compile(r'^(labels?|y|.+_(labels?|y))$')
_NUMBER_AT_END = re.compile(r'[-_ .]*\d*$')
MAX_LEAVES = 100_000
"""Largest number of files in the given folders."""


class SourceKind(Enum):
    """Kind of recording at a path."""

    ARCHIVE = 'archive'
    ARRAY = 'array'
    TABLE = 'table'
    BAG = 'bag'


_KINDS = {
    '.npz': SourceKind.ARCHIVE,
    '.npy': SourceKind.ARRAY,
    **dict.fromkeys(('.csv', '.tsv', '.txt', '.parquet'), SourceKind.TABLE),
    **dict.fromkeys(BAG_SUFFIXES, SourceKind.BAG),
}


@dataclass(frozen=True)
class SourceFile:
    """A file or bag with recordings. ``root`` is the path from the user in which it was found."""

    path: Path
    root: Path
    kind: SourceKind

    @property
    def name(self) -> str:
        """Path relative to ``root``, preceded by the name of ``root``."""
        if self.path == self.root:
            return self.path.name
        return f'{self.root.name}/{self.path.relative_to(self.root).as_posix()}'.lstrip('/')

    @property
    def folder(self) -> str:
        """Name of the folder that contains the file."""
        return self.path.absolute().parent.name

    @property
    def word(self) -> str:
        """Name of the file without its suffix and the number at its end."""
        return _NUMBER_AT_END.sub('', self.path.stem)


def find_leaves(paths: Sequence[Path]) -> list[SourceFile]:
    """Return the files and bags in the given paths, sorted by name within each path.

    Raises `SourceError` if a path does not exist, or contains no known recordings or too many.
    """
    leaves: list[SourceFile] = []
    for path in expand_lists(paths):
        found = _without_labels(list(_walk(path, path)))
        if not found:
            what = (
                'there are no recordings in it'
                if path.is_dir()
                else f'files of type "{path.suffix}" are not supported'
            )
            raise SourceError(f'{path}: {what}\n{LAYOUT}')
        leaves += found
    return leaves


def expand_lists(paths: Sequence[Path]) -> list[Path]:
    """Return the paths, with list files replaced by the paths that they contain.

    The name of a list file ends in ``.txt``. It has one path per line, relative to the file; empty
    lines and lines that begin with ``#`` are ignored.
    """
    found: list[Path] = []
    for path in paths:
        lines = _read_list(path)
        for number, line in lines.items():
            if not (path.parent / line).exists():
                raise SourceError(
                    f'{path}, line {number}: {path.parent / line} does not exist; a path in a '
                    'list of recordings is relative to the list'
                )
        found += [path.parent / line for line in lines.values()] or [path]
    return found


def _read_list(path: Path) -> Mapping[int, str]:
    """Return the paths in a list file by line number; empty if the file is a table."""
    if path.suffix.lower() != '.txt' or not path.is_file():
        return {}
    if path.stat().st_size > MAX_LIST_BYTES:
        return {}
    try:
        lines = enumerate(path.read_text('utf-8').splitlines(), start=1)
    except (OSError, UnicodeDecodeError):
        return {}
    named = {n: line.strip() for n, line in lines if line.strip() and line.strip()[0] != '#'}
    # The file is a list, not a table, if its first line is the path of an existing file.
    first = next(iter(named.values()), '')
    try:
        return named if first and (path.parent / first).exists() else {}
    except OSError:  # for example, the name is too long
        return {}


def _walk(path: Path, root: Path) -> Iterator[SourceFile]:
    if not path.exists():
        raise SourceError(f'{path} does not exist')
    if path.is_file():
        kind = _KINDS.get(path.suffix.lower())
        is_model = kind is SourceKind.ARCHIVE and is_model_file(path)
        if is_model and path == root:
            raise SourceError(f'{path} is a model file; give recordings')
        if kind is not None and not is_model:
            yield SourceFile(path, root, kind)
        return
    if not path.is_dir():  # reading a pipe would never end
        return
    if is_experiment(path):
        bags = sorted(each for each in (path / BAGS).glob('*') if each.is_dir())
        if not bags:
            raise SourceError(f'{path} has no bags yet; run it with `tactile experiment`')
        yield from (SourceFile(bag, root, SourceKind.BAG) for bag in bags)
        return
    inside = sorted(path.iterdir())
    if len(inside) > MAX_LEAVES:
        raise SourceError(f'{path} contains {len(inside)} files; the limit is {MAX_LEAVES}')
    if any(p.name == 'metadata.yaml' or p.name.endswith(BAG_SUFFIXES) for p in inside):
        yield SourceFile(path, root, SourceKind.BAG)
        return
    for child in inside:
        if not child.name.startswith('.'):
            yield from _walk(child, root)


def _without_labels(leaves: list[SourceFile]) -> list[SourceFile]:
    """Return the recordings without files of labels.

    Files with such names are labels only if other files contain arrays. Otherwise, ``y.csv`` or
    ``y.npy`` is a recording.
    """
    recordings = [leaf for leaf in leaves if not _has_label_name(leaf)]
    kinds = {leaf.kind for leaf in recordings}
    return recordings if kinds & {SourceKind.ARRAY, SourceKind.ARCHIVE} else leaves


def _has_label_name(leaf: SourceFile) -> bool:
    is_inside = leaf.path != leaf.root and leaf.path.is_file()
    return is_inside and _LABEL_FILES.match(leaf.path.stem) is not None


def name_labels(
    leaves: Sequence[SourceFile], options: SourceOptions, notes: ImportNotes
) -> list[dict[str, str]]:
    """Return the label of each file, and other columns that follow from its path.

    Other columns are, for example, the named groups of the pattern ``label_from``. If the names do
    not contain labels, the labels are empty, and ``notes.no_label`` is the error with the reason.
    """
    if options.label:
        notes.add(f'label: "{options.label}" for all, as stated')
        return [{'label': options.label} for _ in leaves]
    pattern = options.compile_label_pattern()
    if pattern is not None:
        return [_match(pattern, leaf) for leaf in leaves]
    folders = [leaf.folder for leaf in leaves]
    outer = [leaf.path.absolute().parent.parent.name for leaf in leaves]
    how = options.label_from
    group = '' if how == 'folder' else _find_shared_word(folders)
    columns: dict[str, Sequence[str]] = {}
    if group:
        columns[group] = folders
        notes.add(f'column {group}: the folder of each file ({_name_some(folders)})')
    if group and not how and len(set(outer)) > 1:
        columns['label'] = outer
        notes.add(f'label: the parent of the folder of each file ({_name_some(outer)})')
    else:
        try:
            how = how or _how_labelled(leaves, folders_are_groups=bool(group))
        except SourceError as error:
            notes.no_label = error
    if how == 'folder':
        columns['label'] = folders
        notes.add(f'label: the folder of each file ({_name_some(folders)})')
        if len(set(outer)) > 1:
            column = _find_shared_word(outer) or 'folder'
            columns[column] = outer
            notes.add(f'column {column}: the parent folder of those ({_name_some(outer)})')
    elif how == 'file':
        words = [leaf.word for leaf in leaves]
        columns['label'] = words
        notes.add(f'label: the name of each file without its number ({_name_some(words)})')
        if '' in words:
            empty = leaves[words.index('')].name
            raise SourceError(f'{empty} has a name of digits only; --label-from folder or --label')
    columns.setdefault('label', [''] * len(leaves))
    return [
        dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)
    ]


def _find_shared_word(folders: Sequence[str]) -> str:
    """Return the word of `GROUP_WORDS` that all folders share, such as "day" of day1 and day2.

    Return an empty string if there is none.
    """
    words = {find_group_word(name) for name in folders}
    return words.pop() if len(words) == 1 and len(set(folders)) > 1 else ''


def _how_labelled(leaves: Sequence[SourceFile], *, folders_are_groups: bool) -> str:
    if not folders_are_groups and len({leaf.folder for leaf in leaves}) > 1:
        return 'folder'
    words = {leaf.word for leaf in leaves}
    guess = 'file' if 1 < len(words) < len(leaves) and '' not in words else ''
    first = leaves[0]
    example = f' ({first.path.name} would be {first.word})' if guess else ''
    raise ambiguity(
        f'the label of each file is unknown{example}',
        ('folder', 'file'),
        '--label-from folder, --label-from file, --label-from PATTERN, or --label NAME',
        guess,
    )


def _match(pattern: re.Pattern[str], leaf: SourceFile) -> dict[str, str]:
    # If the user has stated the path of the file itself, the pattern also sees its folder.
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


def decode_text(data: bytes) -> str:
    """Decode the text of a file: UTF-16 with byte order mark, UTF-8, or else Latin-1."""
    if data[:2] in (b'\xff\xfe', b'\xfe\xff'):
        return data.decode('utf-16')
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError:
        return data.decode('latin-1')
