# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""``metadata.yaml`` of a bag: written as rosbag2 does (version 9), checked when it is read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import json
import os
from pathlib import Path
from textwrap import indent
from typing import Any

from tactile_bags.errors import BagError
from tactile_bags.mcap_reader import MAX_METADATA_BYTES, StoredTopic
from tactile_ros.errors import TactileError
from tactile_ros.yaml_files import load_yaml, read_text

VERSION = 9
"""Of the file's form: that of ROS 2 Jazzy and Kilted."""

FILE_NAME = 'metadata.yaml'
_TOP = 'rosbag2_bagfile_information'


@dataclass(frozen=True)
class BagMetadata:
    """Contents of ``metadata.yaml`` that a reader needs.

    ``files`` lie in the bag's folder, in the order of recording. ``packing`` is the mode of the
    zstd compression, ``file`` or ``message``; empty: not compressed. ``topics`` (types),
    ``type_hashes`` and ``counts`` are by name of topic.
    """

    files: tuple[str, ...] = ()
    packing: str = ''
    topics: dict[str, str] = field(default_factory=dict)
    type_hashes: dict[str, str] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    custom: dict[str, str] = field(default_factory=dict)


def read_metadata(path: Path) -> BagMetadata:
    """Read ``metadata.yaml``; `BagError` when it is not of rosbag2's form, or too large."""
    try:
        return parse_metadata(read_text(path, MAX_METADATA_BYTES))
    except TactileError as error:
        raise BagError(f'its {FILE_NAME} cannot be used: {error}') from error


def parse_metadata(text: str) -> BagMetadata:
    """Return what a ``metadata.yaml`` says; `BagError` when it is not of rosbag2's form."""
    document = load_yaml(text)
    if isinstance(document, dict):
        # The copy within a data file begins one level further down.
        document = document.get(_TOP, document)
    try:
        if not 1 <= int(document['version']) <= VERSION:
            raise BagError(f'it has version {document["version"]}, known are 1 to {VERSION}')
        storage = str(document['storage_identifier'])
        topics = [
            (topic['topic_metadata'], int(topic['message_count']))
            for topic in document['topics_with_message_count']
        ]
        packing = str(document.get('compression_mode') or '').lower().replace('none', '')
        packed_as = str(document.get('compression_format') or '')
        metadata = BagMetadata(
            # By their names alone: a bag's files lie in its folder and nowhere else.
            files=tuple(Path(str(name)).name for name in document['relative_file_paths']),
            packing=packing,
            topics={str(t['name']): str(t['type']) for t, _ in topics},
            type_hashes={
                str(t['name']): str(t.get('type_description_hash') or '') for t, _ in topics
            },
            counts={str(t['name']): count for t, count in topics},
            custom={str(k): str(v) for k, v in (document.get('custom_data') or {}).items()},
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BagError(f'it is not of the form that rosbag2 gives it ({error!r})') from error
    if storage not in ('mcap', 'sqlite3'):
        raise BagError(f'the storage "{storage[:40]}" is not known; known are mcap and sqlite3')
    if packing and (packing not in ('file', 'message') or packed_as != 'zstd'):
        raise BagError(f'it is packed as "{packed_as[:40]}"; known is zstd')
    return metadata


def format_metadata(
    file_name: str,
    topics: Sequence[tuple[StoredTopic, int]],
    span_ns: tuple[int, int],
    custom: Mapping[str, str],
) -> str:
    """Return what ``metadata.yaml`` says of a bag of one MCAP file, as YAML.

    ``topics`` come with the number of their messages, ``span_ns`` are the times of the first and
    the last message [ns]. This text is what stands in the data file, too; see `write_metadata`.
    """
    count = sum(n for _, n in topics)
    first_ns = span_ns[0] if count else 0
    duration_ns = max(0, span_ns[1] - span_ns[0]) if count else 0
    name = _quote(file_name)
    lines = [
        f'version: {VERSION}',
        'storage_identifier: mcap',
        'duration:',
        f'  nanoseconds: {duration_ns}',
        'starting_time:',
        f'  nanoseconds_since_epoch: {first_ns}',
        f'message_count: {count}',
        'topics_with_message_count:' + ('' if topics else ' []'),
    ]
    for topic, topic_count in topics:
        lines += [
            '  - topic_metadata:',
            f'      name: {_quote(topic.name)}',
            f'      type: {_quote(topic.type_name)}',
            f'      serialization_format: {_quote(topic.serialization)}',
            '      offered_qos_profiles:' + ('' if topic.qos else ' []'),
            *('          ' + line for line in topic.qos.splitlines()),
            f'      type_description_hash: {_quote(topic.type_hash)}',
            f'    message_count: {topic_count}',
        ]
    lines += [
        'compression_format: ""',
        'compression_mode: ""',
        'relative_file_paths:',
        f'  - {name}',
        'files:',
        f'  - path: {name}',
        '    starting_time:',
        f'      nanoseconds_since_epoch: {first_ns}',
        '    duration:',
        f'      nanoseconds: {duration_ns}',
        f'    message_count: {count}',
        'custom_data:' + ('' if custom else ' {}'),
        *(f'  {_quote(key)}: {_quote(value)}' for key, value in custom.items()),
        f'ros_distro: {_quote(os.environ.get("ROS_DISTRO", ""))}',
    ]
    return '\n'.join(lines) + '\n'


def write_metadata(folder: Path, text: str) -> None:
    """Replace ``metadata.yaml`` at once: there is never half of one."""
    temporary = folder / f'.{FILE_NAME}'
    temporary.write_text(f'{_TOP}:\n{indent(text, "  ")}', 'utf-8')
    os.replace(temporary, folder / FILE_NAME)


def _quote(text: str) -> Any:
    # A text in JSON is one in YAML, too.
    return json.dumps(text, ensure_ascii=False)
