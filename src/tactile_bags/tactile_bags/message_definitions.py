# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The message definitions of ``tactile_msgs``, from a ROS 2 workspace or from this package."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from pathlib import Path

from tactile_bags.errors import BagError

PACKAGE = 'tactile_msgs'


@lru_cache(maxsize=1)
def message_definitions() -> dict[str, str]:
    """Return the text of each ``.msg`` file by the name of its type, such as ``Slip``.

    A sourced workspace comes first: its messages are those that its nodes publish. A
    distribution from pip has the same files in the folder ``tactile_msgs`` of this package.

    Raises
    ------
    BagError
        When neither has them.
    """
    for folder in (_workspace_folder(), resources.files(__package__) / PACKAGE):
        if folder is not None and folder.is_dir():
            files = sorted(folder.iterdir(), key=lambda file: file.name)
            texts = {f.name[:-4]: f.read_text('utf-8') for f in files if f.name.endswith('.msg')}
            if texts:
                return texts
    raise BagError(
        f'the package {PACKAGE} is not installed here; build the workspace and source it'
    )


def _workspace_folder() -> Path | None:
    try:
        from ament_index_python.packages import get_package_share_directory

        return Path(get_package_share_directory(PACKAGE)) / 'msg'
    except LookupError:  # ament knows no such package
        return None
    except ImportError:  # no ROS 2 here
        return None
