# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Message types of a recording, and the quality of service of its topics."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_bags.errors import BagError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_PACKAGE = 'tactile_msgs'


@lru_cache(maxsize=1)
def _message_definitions() -> dict[str, str]:
    """Return a dictionary from the name of each type, such as ``Tare``, to its ``.msg`` text.

    If a workspace is sourced, its definitions are used, because its nodes publish these messages.
    Otherwise, the copy in the folder ``tactile_msgs`` of this package is used, which an
    installation with pip contains.
    """
    for folder in (_workspace_folder(), resources.files(__package__) / _PACKAGE):
        if folder is not None and folder.is_dir():
            files = sorted(folder.iterdir(), key=lambda file: file.name)
            texts = {f.name[:-4]: f.read_text('utf-8') for f in files if f.name.endswith('.msg')}
            if texts:
                return texts
    raise BagError(f'the package {_PACKAGE} is not installed; build the workspace and source it')


def _workspace_folder() -> Path | None:
    try:
        from ament_index_python.packages import get_package_share_directory

        return Path(get_package_share_directory(_PACKAGE)) / 'msg'
    except LookupError:  # the package is not in the ament index
        return None
    except ImportError:  # ROS 2 is not installed
        return None


@lru_cache(maxsize=1)
def message_store() -> Typestore:
    """Return the message types of ROS 2 Jazzy and of ``tactile_msgs``.

    Raises
    ------
    BagError
        When the definitions of ``tactile_msgs`` are not installed.
    """
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores  # slow to import

    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in _message_definitions().items():
        store.register(get_types_from_msg(text, f'tactile_msgs/msg/{name}'))
    return store


def qos_text(*, latched: bool) -> str:
    """Return the offered quality of service of a topic in the notation of rosbag2."""
    return _QOS.format(
        depth=16 if latched else 1000, durability='transient_local' if latched else 'volatile'
    )


_QOS = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""
