# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Physical quantities of a window, each with its uncertainty or the reason why there is none.

See docs/measures.md for what each means, and how far it may be trusted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import math

import numpy as np
from numpy.typing import NDArray

from tactile_features.errors import UndefinedFeatureError
from tactile_features.measures.pitch import find_ripple
from tactile_features.measures.press import (
    measure_press,
    measure_relaxation,
    Press,
    Value,
)
from tactile_features.records import Measure
from tactile_features.windows import Samples

GROOVE_PITCH = 'groove_pitch'
FREE_STIFFNESS = 'free_stiffness'
CONTACT_STIFFNESS = 'contact_stiffness'
RELAXATION_TIME = 'relaxation_time'

_LARGEST_N = 1e9  # no sensor's; squares of it are still numbers


def measure_glide(
    samples: Samples, speed_m_s: float, speed_uncertainty: float
) -> tuple[Measure, ...]:
    """Return the pitch of the grooves under a glide.

    Parameters
    ----------
    samples : ndarray of `windows.SAMPLE`
        The window.
    speed_m_s : float
        Of the glide; 0: not known [m/s].
    speed_uncertainty : float
        Relative standard uncertainty of the speed [1].
    """

    def find_pitch() -> tuple[Value]:
        if not speed_m_s > 0.0:
            raise UndefinedFeatureError('the trial does not say how fast the finger glided')
        ripple = find_ripple(*_split(samples))
        pitch_m = speed_m_s / ripple.frequency_hz
        relative = ripple.standard_uncertainty_hz / ripple.frequency_hz
        return (Value(pitch_m, pitch_m * math.hypot(relative, speed_uncertainty)),)

    return _try(find_pitch, (GROOVE_PITCH,), 'm')


def measure_hold(
    samples: Samples, pull: Samples, pull_speed_m_s: float, no_pull: str = ''
) -> tuple[Measure, ...]:
    """Return the stiffness that the pull into contact met, and how the hold relaxes.

    Parameters
    ----------
    samples, pull : ndarray of `windows.SAMPLE`
        The window of the hold; the samples of the pull before it.
    pull_speed_m_s : float
        Speed of the tendon in the pull; 0: not known [m/s].
    no_pull : str
        Why the samples of the pull are not to be used; empty otherwise.
    """

    def press() -> Press:
        if no_pull:
            raise UndefinedFeatureError(no_pull)
        if not pull_speed_m_s > 0.0:
            raise UndefinedFeatureError('the trial does not say how fast the tendon was pulled')
        return measure_press(*_split(pull), pull_speed_m_s)

    return (
        *_try(press, (FREE_STIFFNESS, CONTACT_STIFFNESS), 'N/m'),
        *_try(lambda: (measure_relaxation(*_split(samples)),), (RELAXATION_TIME,), 's'),
    )


def _split(samples: Samples) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Seconds since the first sample, and tension, each in memory of its own."""
    tension_n = np.array(samples['tension_n'])
    if not (np.abs(tension_n) < _LARGEST_N).all():
        raise UndefinedFeatureError(f'the tension goes beyond {_LARGEST_N:g} N')
    return (samples['stamp_ns'] - samples['stamp_ns'][0]) * 1e-9, tension_n


def _try(
    estimate: Callable[[], Iterable[Value]], names: Sequence[str], unit: str
) -> tuple[Measure, ...]:
    try:
        values = tuple(estimate())
    except UndefinedFeatureError as error:
        return tuple(Measure(name, unit, reason=str(error)) for name in names)
    except (ZeroDivisionError, np.linalg.LinAlgError):
        reason = 'the samples have no spread in time or no ripple'
        return tuple(Measure(name, unit, reason=reason) for name in names)
    return tuple(
        Measure(name, unit, float(value.value), float(value.standard_uncertainty))
        for name, value in zip(names, values, strict=True)
    )
