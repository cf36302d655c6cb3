# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exceptions of the sensor driver."""


class TendonSensorError(Exception):
    """Base class of this package's exceptions."""


class LinkError(TendonSensorError):
    """The link to the sensor cannot be opened or was lost."""
