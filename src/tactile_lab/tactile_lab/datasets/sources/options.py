# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What the command line states about recordings that do not say it themselves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
import re

from tactile_lab.datasets.sources.questions import SourceError

ROLES = ('time', 'trial', 'label', 'value')
"""What a column of a table can be."""


@dataclass(frozen=True)
class SourceOptions:
    """Statements about recordings; each is empty or None where nothing is stated.

    Attributes
    ----------
    columns : tuple of str
        ``ROLE=NAME[,NAME...]``, with a role of `ROLES`; ``time=NAME:UNIT``.
    rate_hz : float or None
        Sample rate [Hz].
    label : str
        The label of all trials.
    label_from : str
        ``folder``, ``file``, or a regular expression for the path of a file.
    labels : Path or None
        File with one label a trial, for arrays.
    topic, field : str
        Of a bag: which messages, and what of them; several fields with commas.
    """

    columns: tuple[str, ...] = ()
    rate_hz: float | None = None
    label: str = ''
    label_from: str = ''
    labels: Path | None = None
    topic: str = ''
    field: str = ''

    @property
    def is_empty(self) -> bool:
        """Whether nothing is stated."""
        return self == SourceOptions()

    @property
    def roles(self) -> dict[str, tuple[str, ...]]:
        """Names of columns by role.

        Raises
        ------
        SourceError
            When a text is not ``ROLE=NAME``.
        """
        roles: dict[str, tuple[str, ...]] = {}
        for text in self.columns:
            role, _, names = text.partition('=')
            if role not in ROLES or not names:
                raise SourceError(
                    f'--column is "{text}"; it must be ROLE=NAME with a role of '
                    f'{", ".join(ROLES)}, as in --column value=force_n'
                )
            roles[role] = tuple(name.strip() for name in names.split(','))
        return roles

    def compile_label_pattern(self) -> re.Pattern[str] | None:
        """Return ``label_from`` as a pattern; None where it is none.

        Raises
        ------
        SourceError
            When it is no regular expression with a group.
        """
        if self.label_from in ('', 'folder', 'file'):
            return None
        try:
            pattern = re.compile(self.label_from)
        except re.error as error:
            raise SourceError(
                f'--label-from: "{self.label_from}" is no pattern: {error}'
            ) from error
        if not pattern.groups:
            raise SourceError(
                f'--label-from: "{self.label_from}" must be folder, file, or a regular '
                r'expression with the label in brackets, as in "(\w+)_\d+"'
            )
        return pattern
