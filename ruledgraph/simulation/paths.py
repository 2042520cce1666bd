# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Building blocks of motions: periodic paths with exact derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ruledgraph.core.arrays import FloatArray
from ruledgraph.simulation.motion import Derivatives, Path, smooth_step


class Waves:
    """A sum of sines: offset + sum_k amplitude_k sin(2 pi frequency_k s + phase_k).

    Args:
        amplitudes: (K, 3).
        frequencies: (K,) or, one for each axis, (K, 3), Hz.
        phases: likewise, rad.
        offset: (3,).
    """

    def __init__(
        self,
        amplitudes: ArrayLike,
        frequencies: ArrayLike,
        phases: ArrayLike = 0.0,
        offset: ArrayLike = 0.0,
    ) -> None:
        self._amplitudes = np.asarray(amplitudes, dtype=np.float64)
        per_axis = np.asarray(frequencies, dtype=np.float64)
        self._rates = 2.0 * np.pi * (per_axis[:, None] if per_axis.ndim == 1 else per_axis)
        offsets = np.asarray(phases, dtype=np.float64)
        self._phases = offsets[:, None] if offsets.ndim == 1 else offsets
        self._offset = np.asarray(offset, dtype=np.float64)

    def __call__(self, phase: FloatArray) -> Derivatives:
        """At phases (...,)."""
        angle = phase[..., None, None] * self._rates + self._phases
        sine, cosine = self._amplitudes * np.sin(angle), self._amplitudes * np.cos(angle)
        return Derivatives(
            np.asarray(sine.sum(axis=-2) + self._offset),
            np.asarray((cosine * self._rates).sum(axis=-2)),
            np.asarray((-sine * self._rates**2).sum(axis=-2)),
        )


def standstill() -> Path:
    """Zero throughout."""
    return Waves(np.zeros((1, 3)), np.zeros(1))


def to_and_fro(amplitude: ArrayLike, period: float) -> Path:
    """Sinusoidal motion along the vector `amplitude` (3,)."""
    return Waves(np.asarray(amplitude)[None], np.array([1.0 / period]))


def circle(first: ArrayLike, second: ArrayLike, period: float) -> Path:
    """Round the origin: first cos(s) + second sin(s), both (3,) and as long as the radius."""
    return Waves(
        np.stack([np.asarray(first), np.asarray(second)]),
        np.full(2, 1.0 / period),
        np.array([0.5 * np.pi, 0.0]),
    )


@dataclass(frozen=True)
class VelocityChange:
    """A change of velocity that takes `length` seconds from `start`: a corner, with a finite
    acceleration that comes and goes smoothly.
    """

    start: float
    length: float
    change: FloatArray
    """(3,), m/s, or rad/s."""


class Legs:
    """Straight legs at constant velocity, joined by changes of velocity; repeats after `period`.

    Args:
        period: s; over one, the path must return to its start and its first velocity.
        first_position: (3,).
        first_velocity: (3,).
        changes: all within one period.
    """

    def __init__(
        self,
        period: float,
        first_position: ArrayLike,
        first_velocity: ArrayLike,
        changes: Sequence[VelocityChange],
    ) -> None:
        self._period = period
        self._first_position = np.asarray(first_position, dtype=np.float64)
        self._first_velocity = np.asarray(first_velocity, dtype=np.float64)
        self._starts = np.array([change.start for change in changes])
        self._lengths = np.array([change.length for change in changes])
        self._changes = np.array([change.change for change in changes])

    def __call__(self, phase: FloatArray) -> Derivatives:
        """At phases (...,)."""
        s = np.mod(phase, self._period)
        step = smooth_step((s[..., None] - self._starts) / self._lengths)
        straight = self._first_position + s[..., None] * self._first_velocity
        return Derivatives(
            np.asarray(straight + (step.integral * self._lengths) @ self._changes),
            np.asarray(self._first_velocity + step.value @ self._changes),
            np.asarray((step.slope / self._lengths) @ self._changes),
        )


def zigzag(amplitude: ArrayLike, speed: float, corner: float) -> Path:
    """To and fro along the vector `amplitude` (3,) at constant speed.

    Args:
        amplitude: where it would turn back if it turned at once, (3,), m.
        speed: m/s.
        corner: how long a turn takes, s.
    """
    reach = np.asarray(amplitude, dtype=np.float64)
    length = float(np.linalg.norm(reach))
    velocity, quarter = reach / length * speed, length / speed
    changes = [
        VelocityChange(quarter - 0.5 * corner, corner, -2.0 * velocity),
        VelocityChange(3.0 * quarter - 0.5 * corner, corner, 2.0 * velocity),
    ]
    return Legs(4.0 * quarter, np.zeros(3), velocity, changes)


def square(first: ArrayLike, second: ArrayLike, speed: float, corner: float, pause: float) -> Path:
    """Round a square about the origin that stops at each corner.

    Args:
        first: one side, (3,), m.
        second: the other, (3,), m.
        speed: along the sides, m/s.
        corner: how long it takes to stop, and to start again, s.
        pause: at each corner, s.
    """
    sides = [np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)]
    times = [float(np.linalg.norm(side)) / speed for side in sides]
    # Time zero is halfway along the first side; speeding up and slowing down each cover half of
    # what full speed would.
    time = -0.5 * (times[0] + corner)
    period = 2.0 * (sum(times) + 2.0 * (corner + pause))
    changes: list[VelocityChange] = []
    for side, duration in zip((*sides, -sides[0], -sides[1]), times * 2, strict=True):
        velocity = side / duration
        changes.append(VelocityChange(time % period, corner, velocity))
        changes.append(VelocityChange(time + duration, corner, -velocity))
        time += duration + corner + pause
    return Legs(period, -0.5 * sides[1], sides[0] / times[0], changes)


def together(*paths: Path) -> Path:
    """The sum of paths."""

    def total(phase: FloatArray) -> Derivatives:
        parts = [path(phase) for path in paths]
        return Derivatives(*(np.sum(column, axis=0) for column in zip(*parts, strict=True)))

    return total
