# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The named motions.

The camera starts near the world's origin and looks along +x at the scene; y is left, z up. Parallel
and perpendicular are meant relative to the plane of the scene, which is perpendicular to x.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.simulation.motion import Motion, Path, PathMotion
from ruledgraph.simulation.paths import (
    Legs,
    VelocityChange,
    Waves,
    circle,
    square,
    standstill,
    to_and_fro,
    together,
    zigzag,
)

WORLD_R_CAM = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Orientation of a level camera that looks along +x."""

_FORWARD, _LEFT, _UP = np.eye(3)
_TILTED = np.array([0.55, 0.7, 0.45]) / np.linalg.norm([0.55, 0.7, 0.45])
_DIAGONAL = (_FORWARD + _UP) / np.sqrt(2.0)

# Reach (m) and period (s) of smooth motion: 0.5 m/s and 1 m/s^2.
_REACH, _PERIOD = 0.25, 3.0
_RADIUS, _ROUND = 0.2, 3.0
# Added rotation about a camera axis, rad and s.
_TURN, _TURN_PERIOD = 0.2, 4.0
# Non-smooth motion: m/s, and s for a corner (7 m/s^2 where a zigzag turns back).
_SPEED, _CORNER = 0.35, 0.2
_SIDE, _PAUSE = 0.35, 0.15
# A walk: m/s, metres to where it stops to turn round, and s for stopping and for standing.
_WALK_SPEED, _WALK_LENGTH, _WALK_STOP, _WALK_WAIT = 1.15, 15.0, 0.8, 1.4


class _Paths(NamedTuple):
    position: Path
    rotation_vector: Path


class NamedMotion(NamedTuple):
    """What `--list` shows, and how it is made."""

    description: str
    build: Callable[[np.random.Generator], _Paths]


def _free(rng: np.random.Generator) -> _Paths:
    """Hand-held: slow sways and quicker, smaller ones on every axis."""
    frequencies = rng.uniform([[0.1], [0.25], [0.5], [0.8]], [[0.2], [0.45], [0.75], [1.1]], (4, 6))
    phases = rng.uniform(0.0, 2.0 * np.pi, (4, 6))
    # Position in m, then rotation in rad.
    size = np.repeat([1.0, 0.6], 3) * rng.uniform(0.7, 1.2, (4, 6))
    sizes = np.array([[0.16], [0.11], [0.05], [0.03]]) * size
    return _Paths(
        *(Waves(sizes[:, i], frequencies[:, i], phases[:, i]) for i in (slice(3), slice(3, 6)))
    )


def _walk(_rng: np.random.Generator) -> _Paths:
    """Down the corridor and back; the camera bobs with the steps and looks about a little."""
    velocity = _WALK_SPEED * _FORWARD
    walk = _WALK_LENGTH / _WALK_SPEED
    turn = 2.0 * _WALK_STOP + _WALK_WAIT
    half = walk + turn
    legs = Legs(
        2.0 * half,
        np.zeros(3),
        velocity,
        [
            VelocityChange(begin + start, _WALK_STOP, sign * velocity)
            for begin, sign in ((0.0, -1.0), (half, 1.0))
            for start in (walk, walk + _WALK_STOP + _WALK_WAIT)
        ],
    )
    # Turning about the camera's y axis, by pi and back.
    rate = 2.0 * np.pi / turn * np.array([0.0, 1.0, 0.0])
    heading = Legs(
        2.0 * half,
        np.zeros(3),
        np.zeros(3),
        [
            VelocityChange(start, 0.5 * turn, sign * rate)
            for start, sign in (
                (walk, 1.0),
                (walk + 0.5 * turn, -1.0),
                (half + walk, -1.0),
                (half + walk + 0.5 * turn, 1.0),
            )
        ],
    )
    # Two steps a second; sideways and rolling it takes two steps for a cycle.
    bobbing = Waves([0.02 * _UP, 0.02 * _LEFT], [2.0, 1.0])
    looking = Waves(
        [[0.012, 0.0, 0.0], [0.0, 0.0, 0.015], [0.0, 0.02, 0.0], [0.05, 0.15, 0.0]],
        [2.0, 1.0, 1.0, 0.21],
        [0.5, 1.0, 0.0, 0.0],
    )
    return _Paths(together(legs, bobbing), together(heading, looking))


def _fixed(position: Path, rotation_vector: Path | None = None) -> Callable[..., _Paths]:
    paths = _Paths(position, standstill() if rotation_vector is None else rotation_vector)
    return lambda _rng: paths


def _named_motions() -> dict[str, NamedMotion]:
    smooth = {
        "linear-parallel": (
            "to and fro along the scene, sinusoidal",
            to_and_fro(_REACH * _LEFT, _PERIOD),
        ),
        "linear-perpendicular": (
            "to and from the scene, sinusoidal",
            to_and_fro(_REACH * _FORWARD, _PERIOD),
        ),
        "linear-tilted": ("to and fro aslant, sinusoidal", to_and_fro(_REACH * _TILTED, _PERIOD)),
        "circular-parallel": (
            "circle in a plane parallel to the scene",
            circle(_RADIUS * _LEFT, _RADIUS * _UP, _ROUND),
        ),
        "circular-perpendicular": (
            "level circle, to and from the scene",
            circle(_RADIUS * _LEFT, _RADIUS * _FORWARD, _ROUND),
        ),
        "circular-tilted": (
            "circle about an axis tilted by 45 degrees",
            circle(_RADIUS * _LEFT, _RADIUS * _DIAGONAL, _ROUND),
        ),
    }
    sharp = {
        "zigzag-parallel": (
            "to and fro along the scene, sharp turns",
            zigzag(_REACH * _LEFT, _SPEED, _CORNER),
        ),
        "zigzag-perpendicular": (
            "to and from the scene, sharp turns",
            zigzag(_REACH * _FORWARD, _SPEED, _CORNER),
        ),
        "zigzag-tilted": (
            "to and fro aslant, sharp turns",
            zigzag(_REACH * _TILTED, _SPEED, _CORNER),
        ),
        "square-parallel": (
            "square parallel to the scene, stops at corners",
            square(_SIDE * _LEFT, _SIDE * _UP, _SPEED, _CORNER, _PAUSE),
        ),
        "square-perpendicular": (
            "level square, stops at corners",
            square(_SIDE * _LEFT, _SIDE * _FORWARD, _SPEED, _CORNER, _PAUSE),
        ),
    }
    motions: dict[str, NamedMotion] = {}
    for name, (description, path) in smooth.items():
        motions[name] = NamedMotion(description, _fixed(path))
        for axis, direction in zip("xyz", np.eye(3), strict=True):
            motions[f"{name}-rot-{axis}"] = NamedMotion(
                f"the same, turning about the camera's {axis.upper()} axis",
                _fixed(path, to_and_fro(_TURN * direction, _TURN_PERIOD)),
            )
    for name, (description, path) in sharp.items():
        motions[name] = NamedMotion(description, _fixed(path))
    motions["free"] = NamedMotion("hand-held, another one for every seed", _free)
    motions["walk"] = NamedMotion("down a corridor of 15 m at 1.15 m/s, and back", _walk)
    return motions


MOTIONS = _named_motions()


def make_motion(
    name: str,
    body_R_cam: FloatArray,
    duration: float = 12.0,
    moving_start: bool = False,
    seed: int = 0,
) -> Motion:
    """A named motion.

    Args:
        name: one of `MOTIONS`.
        body_R_cam: how the camera is mounted, (3, 3).
        duration: s, as long as you like.
        moving_start: at full speed from the beginning; by default one second of rest.
        seed: for the motions that have a random part.

    Raises:
        RuledgraphError: for a name that is not known or a duration that is not positive.
    """
    if name not in MOTIONS:
        raise RuledgraphError(f"unknown motion {name!r}; use one of {', '.join(MOTIONS)}")
    if not duration > 0.0:
        raise RuledgraphError(f"duration {duration} s is not positive")
    position, rotation_vector = MOTIONS[name].build(np.random.default_rng([seed, 1]))
    return PathMotion(position, rotation_vector, WORLD_R_CAM, body_R_cam, duration, moving_start)
