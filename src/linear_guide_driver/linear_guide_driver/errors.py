# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of the motion drivers."""


def capitalise(sentence: str) -> str:
    """Return a sentence with a capital first letter; `str.capitalize` changes the others."""
    return sentence[:1].upper() + sentence[1:]


class LinearGuideDriverError(Exception):
    """Base class of the package's exceptions; the message is a sentence with a remedy."""


class DeviceConnectionError(LinearGuideDriverError):
    """The device cannot be reached, or the connection to it was lost."""


class DeviceRefusedError(LinearGuideDriverError):
    """The device refused a command, or its settings do not allow its use."""


class MotionRefusedError(LinearGuideDriverError):
    """The motion was not started."""


class MotionFailedError(LinearGuideDriverError):
    """The motion was started and ended because of a fault."""


class MotionStoppedError(LinearGuideDriverError):
    """The motion was started and ended early on request."""
