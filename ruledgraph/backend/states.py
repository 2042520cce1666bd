# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a window is made of: knots, the intervals between them, and their priors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, V, X

from ruledgraph.backend.landmarks import GraphLine
from ruledgraph.backend.time_offset import OffsetLink, TimeOffset
from ruledgraph.calibration.sensors import FloatArray
from ruledgraph.frontend.tracks import Sighting, Track
from ruledgraph_factors import (
    NEW_LINE_SIGMAS,
    STANDARD_GRAVITY,
    FrameMotion,
    GeometricPoints,
    LineChart,
    RuledSurfaceFactor,
    line_distance_factor,
    new_line_factor,
)
from ruledgraph_factors.ruled_surface import State

# A new line's plane is good to this, rad: it was seen, and not long ago.
_NEW_PLANE = 0.05
# How far away a line is, m, and by what factor that may be wrong.
_DISTANCE, _DISTANCE_FACTOR = 3.0, 4.0
_GRAVITY = np.array(STANDARD_GRAVITY)
# The velocity (m/s) of a knot that lies so long (s) before the end of a rest: later ones may have
# begun to move. How far it may be from the first knot of the rest (rad, m).
_STILL_VELOCITY, _MID_REST = 0.005, 0.15
_STILL_POSE = 3e-3


@dataclass(eq=False)
class Knot:
    """A state of the graph."""

    index: int
    time: float
    state: gtsam.NavState
    bias: gtsam.imuBias.ConstantBias
    covariances: tuple[FloatArray, FloatArray, FloatArray]
    """Of pose (6, 6), velocity (3, 3) and bias (6, 6), when it was new."""


@dataclass(eq=False)
class Interval:
    """The frames after a knot, up to and including the next knot's."""

    knot: Knot
    stamps: list[int]
    """Of its frames, ns."""
    motion: FrameMotion
    imu_factors: list[gtsam.NonlinearFactor]
    known: int
    """How many of its frames come before a doubt of the IMU: the others' poses are guesses."""
    again: int = 0
    """1 when the knot's own frame is the first: the interval before could not place it."""
    link: OffsetLink | None = None
    """The time offset of its frames, when that is estimated."""
    still: bool = False
    """Whether the body rested all the time, and for some time before."""
    observations: list["Observation"] = field(default_factory=list)
    offsets: list[float] = field(default_factory=list)
    """How far the points of each line that was compared with the estimate, when the interval was
    the newest one, were off on average, by what they should be ..."""
    misfits: int = 0
    """... and how many of these lines did not fit their points."""
    _placed: tuple[gtsam.NavState, list[gtsam.Pose3]] | None = None
    _cameras: tuple[list[gtsam.Pose3], list[gtsam.Pose3]] | None = None

    @property
    def is_known(self) -> bool:
        """Whether there is no doubt in it."""
        return self.known == len(self.stamps)

    @property
    def time_shift(self) -> float:
        """How much later than `motion` says its frames were taken, s."""
        return 0.0 if self.link is None else self.link.shift

    def poses(self) -> list[gtsam.Pose3]:
        """world_T_body of its frames, computed anew when the knot's state is replaced."""
        placed, knot = self._placed, self.knot
        if placed is None or placed[0] is not knot.state:
            poses = self.motion.poses(knot.state, knot.bias, time_shift=self.time_shift)
            placed = self._placed = knot.state, poses
        return placed[1]

    def cameras(self, body_T_cam: gtsam.Pose3) -> list[gtsam.Pose3]:
        """world_T_cam of its frames: `poses` with the camera's place in the body."""
        bodies, cameras = self.poses(), self._cameras
        if cameras is None or cameras[0] is not bodies:
            cameras = self._cameras = bodies, [pose.compose(body_T_cam) for pose in bodies]
        return cameras[1]

    def state(self, delta: FloatArray) -> State:
        """What the factor of a line at `delta` depends on."""
        pose, velocity = self.knot.state.pose().matrix(), self.knot.state.velocity()
        bias = self.knot.bias.vector()
        return State(pose, velocity, bias, _GRAVITY, delta, self.time_shift)

    def seen(self, track: Track) -> tuple[list[int], list[Sighting]]:
        """In which of its known frames a track was seen, and what there."""
        hits: list[Sighting] = []
        for sighting in reversed(track.sightings):
            if sighting.stamp < self.stamps[0]:
                break
            hits.append(sighting)
        places = {stamp: i for i, stamp in enumerate(self.stamps[: self.known])}
        hits = [sighting for sighting in reversed(hits) if sighting.stamp in places]
        return [places[sighting.stamp] for sighting in hits], hits


class Observation(NamedTuple):
    """A line in an interval."""

    line: GraphLine
    factor: RuledSurfaceFactor
    points: GeometricPoints
    last: tuple[int, FloatArray]
    """The last frame that saw it, by its place in the interval, and the points there."""


@dataclass(frozen=True, eq=False)
class Start:
    """Where a window begins."""

    stamp: int
    """Of its frame, ns."""
    time: float
    state: gtsam.NavState
    bias: gtsam.imuBias.ConstantBias
    pose_covariance: FloatArray
    velocity_sigma: float
    bias_sigmas: FloatArray
    lines: dict[int, tuple[LineChart, FloatArray]]
    """Of tracks by number: what is known of them already."""
    time_offset: TimeOffset | None = None
    """Beyond the frames' times; None: not to be estimated."""

    def moved(self, by: gtsam.Pose3) -> "Start":
        """The same start in another world: turned about the vertical and shifted, `by` a pose."""
        pose = by.compose(self.state.pose())
        velocity = by.rotation().rotate(self.state.velocity())
        lines = {
            number: (LineChart(by.compose(chart.world_T_anchor), chart.basis, chart.angle), delta)
            for number, (chart, delta) in self.lines.items()
        }
        return replace(self, state=gtsam.NavState(pose, velocity), lines=lines)


def insert_state(values: gtsam.Values, knot: Knot) -> None:
    """A knot's variables: X, V and B of its index."""
    values.insert(X(knot.index), knot.state.pose())
    values.insert(V(knot.index), knot.state.velocity())
    values.insert(B(knot.index), knot.bias)


def add_priors(factors: gtsam.NonlinearFactorGraph, knot: Knot, inflation: float = 1.0) -> None:
    """Priors of a knot with its own covariances, `inflation` times the deviations."""
    pose, velocity, bias = (
        noiseModel.Gaussian.Covariance(c * inflation**2) for c in knot.covariances
    )
    factors.addPriorPose3(X(knot.index), knot.state.pose(), pose)
    factors.addPriorVector(V(knot.index), knot.state.velocity(), velocity)
    factors.addPriorConstantBias(B(knot.index), knot.bias, bias)


def of_new_line(knot: Knot, seen: Observation) -> tuple[gtsam.NonlinearFactor, ...]:
    """What is known of a line before it is looked at from two places, by its first observation.

    It is all said of the line as seen from that knot. Priors in the world's frame would do as well
    for the line; but with every line that came, place and heading, which nothing shows, would seem
    better known, and be drawn to where the priors fit.
    """
    line, spec, points = seen.line, seen.factor.spec, seen.points
    wide = noiseModel.Diagonal.Sigmas(np.array(NEW_LINE_SIGMAS))
    factor = noiseModel.Isotropic.Sigma(1, math.log(_DISTANCE_FACTOR))
    # The robust loss gives up points that are far off, and one bad step would carry the line away
    # for good: its points once more, loose and without that loss.
    loose = noiseModel.Isotropic.Sigma(points.rows, _NEW_PLANE * math.sqrt(points.weight))
    pose_key, pose = spec.keys[0], knot.state.pose()
    return (
        new_line_factor(wide, pose_key, line.key, line.chart, pose),
        line_distance_factor(factor, pose_key, line.key, line.chart, _DISTANCE),
        RuledSurfaceFactor(replace(spec, noise_model=loose)),
    )


def resting(intervals: Sequence[Interval]) -> list[Interval]:
    """Those of the rest that goes on until the newest knot, newest first."""
    return list(takewhile(lambda interval: interval.still, reversed(intervals)))


def rest_factors(intervals: Sequence[Interval], now: float) -> list[gtsam.NonlinearFactor]:
    """What a rest says that goes on until the newest knot, at time `now`, of the knot in its
    middle: no velocity, and no motion since its first knot. The knot's interval keeps them.
    """
    rest = resting(intervals)
    middle = next((part for part in rest if part.knot.time <= now - _MID_REST), None)
    if middle is None:
        return []
    first, k = rest[-1].knot.index, middle.knot.index
    slow = noiseModel.Isotropic.Sigma(3, _STILL_VELOCITY)
    factors: list[gtsam.NonlinearFactor] = [gtsam.PriorFactorVector(V(k), np.zeros(3), slow)]
    if k > first:
        near = noiseModel.Isotropic.Sigma(6, _STILL_POSE)
        factors.append(gtsam.BetweenFactorPose3(X(first), X(k), gtsam.Pose3(), near))
    middle.imu_factors += factors
    return factors
