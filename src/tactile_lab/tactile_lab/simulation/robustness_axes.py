# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Axes of the robustness study: conditions that get worse one at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from tactile_bringup.records import TrialConfig
from tactile_sim.descriptions.description import LoadCell


@dataclass(frozen=True)
class Sensing:
    """Sensor effects on the same motion; None keeps the value of the rig's description.

    Attributes
    ----------
    noise_n, drift_n_rt_s : float or None
        Standard deviation of noise [N], random walk of the zero in a root second [N].
    lost : float
        Fraction of samples lost, each independently [1].
    jitter : float
        Standard deviation of the sampling time, in periods [1]. The stamps do not show it.
    """

    noise_n: float | None = None
    drift_n_rt_s: float | None = None
    lost: float = 0.0
    jitter: float = 0.0


@dataclass(frozen=True)
class Setting:
    """One condition: how the trial runs, how fast is sampled, what the sensor does.

    Gaps of up to ``max_gap_samples`` are bridged; see `FeatureConfig`.
    """

    axis: str
    value: float
    glide_speed_m_s: float | None = None
    depth: float = 1.0
    rate_hz: float | None = None
    max_gap_samples: int = 0
    sensing: Sensing = field(default_factory=Sensing)

    @property
    def motion(self) -> tuple[float | None, float, float | None]:
        """Values that define the motion; a different tuple needs a new simulation."""
        return self.glide_speed_m_s, self.depth, self.rate_hz


@dataclass(frozen=True)
class Axis:
    """One thing that gets worse.

    Attributes
    ----------
    nominal : float
        Its value where the others are varied.
    trains_elsewhere : bool
        Whether a model that was trained at the nominal value can be asked at all: it refuses
        another sample rate.
    """

    name: str
    unit: str
    settings: tuple[Setting, ...]
    nominal: float
    trains_elsewhere: bool = True


def list_axes(cell: LoadCell, config: TrialConfig) -> tuple[Axis, ...]:
    """Return what is varied, around the rig's own values."""
    steps = (1.0, 3.0, 10.0, 30.0)
    lost = (0.0, 0.003, 0.01, 0.03, 0.1)
    speeds_m_s = (0.005, 0.010, 0.0135, config.glide_speed_m_s, 0.0165)

    def sensed(
        name: str, unit: str, key: str, nominal: float, values: Sequence[Any], **more: Any
    ) -> Axis:
        settings = tuple(Setting(name, v, sensing=Sensing(**{key: v}), **more) for v in values)
        return Axis(name, unit, settings, nominal)

    def moved(
        name: str, unit: str, key: str, nominal: float, values: Sequence[Any], **more: Any
    ) -> Axis:
        settings = tuple(Setting(name, v, **{key: v}) for v in values)
        return Axis(name, unit, settings, nominal, **more)

    noise_n, drift_n_rt_s = cell.noise_n, cell.drift_n_rt_s
    return (
        sensed('noise', 'N', 'noise_n', noise_n, [noise_n * s for s in steps]),
        sensed(
            'drift', 'N/√s', 'drift_n_rt_s', drift_n_rt_s, [drift_n_rt_s * s**2 for s in steps]
        ),
        sensed('lost samples', 'share', 'lost', 0.0, lost),
        sensed('lost samples, gaps bridged', 'share', 'lost', 0.0, lost, max_gap_samples=3),
        sensed('jitter', 'periods', 'jitter', 0.0, (0.0, 0.1, 0.3, 0.6)),
        moved('glide speed', 'm/s', 'glide_speed_m_s', config.glide_speed_m_s, speeds_m_s),
        moved('contact depth', 'of nominal pull', 'depth', 1.0, (0.8, 0.9, 1.0, 1.1)),
        moved(
            'sample rate',
            'Hz',
            'rate_hz',
            cell.rate_hz,
            (15.0, 30.0, cell.rate_hz, 120.0),
            trains_elsewhere=False,
        ),
    )
