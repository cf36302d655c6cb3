# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reading and writing of ``metadata.yaml`` in the format of rosbag2, version 9."""

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
"""Version of the format, as in ROS 2 Jazzy and Kilted."""

FILE_NAME = 'metadata.yaml'
_TOP = 'rosbag2_bagfile_information'


@dataclass(frozen=True)
class BagMetadata:
    """Contents of ``metadata.yaml`` that a reader needs.

    ``files`` are names of files in the folder of the bag, in the order of recording. ``packing``
    is the mode of the zstd compression, ``file`` or ``message``; empty if the bag is not
    compressed. ``topics``, ``type_hashes`` and ``counts`` map the name of each topic to its type,
    its type hash and its number of messages.
    """

    files: tuple[str, ...] = ()
    packing: str = ''
    topics: dict[str, str] = field(default_factory=dict)
    type_hashes: dict[str, str] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    custom: dict[str, str] = field(default_factory=dict)


def read_metadata(path: Path) -> BagMetadata:
    """Read ``metadata.yaml``; raise `BagError` if it is too large or invalid."""
    try:
        return parse_metadata(read_text(path, MAX_METADATA_BYTES))
    except TactileError as error:
        raise BagError(f'its {FILE_NAME} cannot be used: {error}') from error


def parse_metadata(text: str) -> BagMetadata:
    """Return the contents of ``metadata.yaml``; raise `BagError` if they are invalid."""
    document = load_yaml(text)
    if isinstance(document, dict):
        # The contents of the file are below this key; the copy in a data file does not have it.
        document = document.get(_TOP, document)
    try:
        if not 1 <= int(document['version']) <= VERSION:
            raise BagError(f'it has version {document["version"]}, but must have 1 to {VERSION}')
        storage = str(document['storage_identifier'])
        topics = [
            (topic['topic_metadata'], int(topic['message_count']))
            for topic in document['topics_with_message_count']
        ]
        packing = str(document.get('compression_mode') or '').lower().replace('none', '')
        packed_as = str(document.get('compression_format') or '')
        metadata = BagMetadata(
            # Only the names are used, without folders: the files must be in the folder of the bag.
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
        raise BagError(f'it does not have the format of rosbag2 ({error!r})') from error
    if storage not in ('mcap', 'sqlite3'):
        raise BagError(f'the storage "{storage[:40]}" is not supported; use mcap or sqlite3')
    if packing and (packing not in ('file', 'message') or packed_as != 'zstd'):
        raise BagError(f'its compression "{packed_as[:40]}" is not supported; use zstd')
    return metadata


def format_metadata(
    file_name: str,
    topics: Sequence[tuple[StoredTopic, int]],
    span_ns: tuple[int, int],
    custom: Mapping[str, str],
) -> str:
    """Return the contents of ``metadata.yaml``, as YAML, for a bag with one MCAP file.

    ``topics`` contains each topic with its number of messages. ``span_ns`` contains the times of
    the first and the last message [ns]. The data file contains a copy of this text; see
    `write_metadata`.
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
    """Replace ``metadata.yaml`` atomically."""
    temporary = folder / f'.{FILE_NAME}'
    temporary.write_text(f'{_TOP}:\n{indent(text, "  ")}', 'utf-8')
    os.replace(temporary, folder / FILE_NAME)


def _quote(text: str) -> Any:
    # A string in JSON notation is also valid YAML.
    return json.dumps(text, ensure_ascii=False)
