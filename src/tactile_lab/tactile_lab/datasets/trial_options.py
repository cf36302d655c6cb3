# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which trials of recordings a command takes, and which features of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactile_lab.datasets.sources.options import ArchiveOptions

if TYPE_CHECKING:
    from tactile_lab.datasets.selection import TrainTest


@dataclass(frozen=True, kw_only=True)
class TrialOptions(ArchiveOptions):
    """What `features`, `evaluate`, `compare` and `train` share; see their ``--help``.

    A command that has one of these as an option declares it anew, with its help.
    """

    task: str | None = None
    train_where: str | None = None
    test_where: str | None = None
    over: str | None = None
    detrend: str | None = None
    features: str | None = None

    @property
    def train_test(self) -> TrainTest:
        """The stated split into trials to train on and to test on."""
        from tactile_lab.datasets.selection import (
            TrainTest,  # NumPy, which ``--help`` does not need
        )

        return TrainTest(self.train_where, self.test_where)
