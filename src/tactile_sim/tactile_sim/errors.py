# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exceptions of the simulator."""

from __future__ import annotations


class TactileSimError(Exception):
    """Base class of all errors of this package."""


class DescriptionError(TactileSimError):
    """A description of a finger, rig, plate or object is invalid, or its name is unknown."""


class ConvergenceError(TactileSimError):
    """The solver found no solution for a time step of the simulation."""


class RigError(TactileSimError):
    """The process of the simulated rig ended, did not start or refused a request."""


class TautTendonError(RigError):
    """The object under the finger cannot be changed, because the tendon is tightened."""


class SolverError(TactileSimError):
    """The solver of the simulation cannot be loaded or compiled."""
