# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of the motion drivers."""


def capitalise(sentence: str) -> str:
    """Return a sentence with a capital first letter; `str.capitalize` changes the others."""
    return sentence[:1].upper() + sentence[1:]


class LinearGuideDriverError(Exception):
    """Root of the package's errors; the message is one sentence with the remedy."""


class DeviceConnectionError(LinearGuideDriverError):
    """The device cannot be reached, or the line to it was lost."""


class DeviceRefusedError(LinearGuideDriverError):
    """The device answers but refuses, or is set up so that it must not be used."""


class MotionRefusedError(LinearGuideDriverError):
    """The motion was not started."""


class MotionFailedError(LinearGuideDriverError):
    """The motion was started and ended by a fault."""


class MotionStoppedError(LinearGuideDriverError):
    """The motion was started and ended early because somebody asked for it."""
