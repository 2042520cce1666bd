# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A new line in 3D from its sightings, the motion being known."""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph.sensors import FloatArray
from ruledgraph_factors import (
    CompressedPoints,
    FactorError,
    FrameMotion,
    LineChart,
    RuledSurfaceSpec,
    line_from_ruling,
)
from ruledgraph_factors.factor import evaluation
from ruledgraph_factors.ruled_surface import State

# Where to start from: inverse distances, 1/m, and turns inside the viewing plane, rad.
_INVERSE_DISTANCES = (0.05, 0.25, 0.7, 1.6)
_TURNS = (-0.7, 0.0, 0.7)
_BEST_STARTS = 2
_MOST_STEPS = 8
_LONGEST_STEP = 1.5
_CONVERGED = 1e-3
# Keeps the two directions that one image does not show finite; the others are seen. Information
# of delta.
_PRIOR = np.array([1.0, 1.0, 1e-4, 1e-4])
_NO_VELOCITY, _NO_BIAS, _NO_GRAVITY = np.zeros(3), np.zeros(6), np.zeros(3)


@dataclass(frozen=True, eq=False)
class LineFit:
    """A line, at zero of its chart."""

    chart: LineChart
    inverse: float
    """One over its distance from the first camera, 1/m, and the deviation of that."""
    inverse_sigma: float
    misfit: float
    """Root mean square distance of the points, normalised units."""


def triangulate(
    world_T_cams: Sequence[gtsam.Pose3],
    points: CompressedPoints,
    first_points: FloatArray,
    deviation: float,
) -> LineFit | None:
    """Least squares over a new line alone, from several distances and directions.

    Args:
        world_T_cams: the cameras that saw it; the first anchors the line.
        points: what each of them saw.
        first_points: the points of the first, (N, 2), normalised.
        deviation: of a point, normalised units.

    Returns:
        The best fit, None if the points define no line.
    """
    anchor = world_T_cams[0]
    try:
        chart = line_from_ruling(anchor, first_points, _INVERSE_DISTANCES[1])
    except FactorError:
        return None
    problem = _Problem(chart, world_T_cams, points, deviation)
    turns = [(np.arctan(i) - chart.angle, turn) for i in _INVERSE_DISTANCES for turn in _TURNS]
    starts = [np.array([nearer, turn, 0.0, 0.0]) for nearer, turn in turns]
    starts.sort(key=problem.cost)
    delta, cost, hessian = min(
        (_descend(start, problem) for start in starts[:_BEST_STARTS]), key=lambda found: found[1]
    )
    inverse, slope = chart.inverse_distance(delta)
    basis = gtsam.Rot3(chart.basis).retract(delta[1:]).matrix()
    angle = chart.angle + delta[0]
    recentred = LineChart(anchor, basis, angle - np.pi * np.round(angle / np.pi))
    sigma = float(np.sqrt(slope @ np.linalg.solve(hessian, slope)))
    return LineFit(recentred, inverse, sigma, deviation * float(np.sqrt(cost / points.weight)))


class _Problem:
    """The cost of a line among cameras that stand fast, as a factor whose frames they are."""

    def __init__(
        self,
        chart: LineChart,
        world_T_cams: Sequence[gtsam.Pose3],
        points: CompressedPoints,
        deviation: float,
    ) -> None:
        anchor = chart.world_T_anchor
        spec = RuledSurfaceSpec(
            form="knot",
            keys=(0, 1, 2, 3),  # of no graph
            noise_model=noiseModel.Unit.Create(points.rows),
            chart=chart,
            motion=_motion([anchor.between(camera) for camera in world_T_cams]),
            points=points,
            body_T_cam=gtsam.Pose3(),
            gravity=_NO_GRAVITY,
        )
        self._evaluate = evaluation(spec)
        self._information = 1.0 / deviation**2
        still = anchor.matrix(), _NO_VELOCITY, _NO_BIAS, _NO_GRAVITY
        self._at_zero = State(*still, line=np.zeros(4))

    def cost(self, delta: FloatArray) -> float:
        """Sum of squares, whitened, with the prior's."""
        value = self._evaluate(self._at_zero._replace(line=delta), False).value
        return self._information * float(value @ value) + float(_PRIOR @ delta**2)

    def linearize(self, delta: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """`cost` with half its gradient, (4,), and half its Gauss-Newton Hessian, (4, 4)."""
        value, jacobian = self._evaluate(self._at_zero._replace(line=delta), True)
        assert jacobian is not None  # noqa: S101 - it was asked for
        by_line = jacobian[:, 18:22]
        cost = self._information * float(value @ value) + float(_PRIOR @ delta**2)
        gradient = self._information * (by_line.T @ value) + _PRIOR * delta
        hessian = self._information * (by_line.T @ by_line)
        hessian.flat[::5] += _PRIOR
        return cost, gradient, hessian


def _motion(knot_T_frames: Sequence[gtsam.Pose3]) -> FrameMotion:
    """Motion that brings a knot without velocity to these poses, whatever the time."""
    count = len(knot_T_frames)
    motion = np.zeros((count, 9))
    for row, pose in zip(motion, knot_T_frames, strict=True):
        row[:3] = gtsam.Rot3.Logmap(pose.rotation())
        row[3:6] = pose.translation()
    return FrameMotion(np.arange(count, dtype=float), motion, np.zeros((count, 9, 6)), _NO_BIAS)


def _descend(delta: FloatArray, problem: _Problem) -> tuple[FloatArray, float, FloatArray]:
    """Levenberg-Marquardt: delta, cost and half the Hessian where it ends."""
    damping = 1e-3
    cost, gradient, hessian = problem.linearize(delta)
    for _ in range(_MOST_STEPS):
        damped = hessian.copy()
        damped.flat[::5] *= 1.0 + damping
        step = -np.linalg.solve(damped, gradient)
        step *= min(1.0, _LONGEST_STEP / float(np.linalg.norm(step) + 1e-12))
        tried = problem.linearize(delta + step)
        gained = cost - tried[0]
        if not gained > 0.0:
            damping *= 10.0
            continue
        delta, damping = delta + step, 0.2 * damping
        cost, gradient, hessian = tried
        if gained < _CONVERGED * cost:
            break
    return delta, cost, hessian
