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

"""Which trials of recordings a command takes, and which features of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tactile_lab.datasets.sources.options import SourceOptions
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_lab.datasets.selection import TrainTest


@dataclass(frozen=True, kw_only=True)
class TrialOptions:
    """What `train`, `evaluate` and `features` share; see their ``--help``."""

    task: str | None = None
    channel: str | None = None
    where: str | None = None
    train_where: str | None = None
    test_where: str | None = None
    crop: str | None = None
    resample_hz: float | None = None
    skip_bad: bool = False
    over: str | None = None
    speed_column: str | None = None
    detrend: str | None = None
    features: str | None = None
    sources: SourceOptions = field(default_factory=SourceOptions)

    @property
    def train_test(self) -> TrainTest:
        """The stated split into trials to train on and to test on."""
        from tactile_lab.datasets.selection import (
            TrainTest,  # NumPy, which ``--help`` does not need
        )

        return TrainTest(self.train_where, self.test_where)

    def check_for_bags(self) -> None:
        """Refuse what says how to cut or read trials, which bags with trial events say.

        Raises
        ------
        TactileError
            When such an option is given.
        """
        for name in ('channel', 'where', 'crop', 'resample_hz', 'skip_bad', 'speed_column'):
            if getattr(self, name) not in (None, False):
                option = name.replace('_', '-')
                raise TactileError(
                    f'--{option} is for archives; a bag says itself what a trial is'
                )
        if not self.sources.is_empty:
            raise TactileError(
                'these are bags with trial events, which say themselves what a trial is: leave '
                '--column, --rate-hz, --label, --label-from, --labels and --field out'
            )
