# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exceptions of the simulator."""

from __future__ import annotations


class TactileSimError(Exception):
    """Root of all errors of this package."""


class DescriptionError(TactileSimError):
    """A description of the rig, or a name in it, is unusable."""


class ConvergenceError(TactileSimError):
    """A step of the physics found no solution."""


class RigError(TactileSimError):
    """The simulated rig's process died, did not start or refused a request."""


class SolverError(TactileSimError):
    """The solver of the physics cannot be loaded or compiled."""
