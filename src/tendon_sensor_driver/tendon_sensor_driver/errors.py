# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exceptions of the sensor driver."""


class TendonSensorError(Exception):
    """Root of this package's errors."""


class LinkError(TendonSensorError):
    """The link to the sensor cannot be opened, or broke."""
