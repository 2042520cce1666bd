# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A new line in 3D from its sightings, the motion being known."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph.sensors import FloatArray
from ruledgraph_factors import (
    STANDARD_GRAVITY,
    CompressedPoints,
    FactorError,
    FrameMotion,
    LineChart,
    RuledSurfaceSpec,
    line_from_ruling,
)
from ruledgraph_factors.factor import evaluation
from ruledgraph_factors.ruled_surface import Residual, State

# Where to start from: inverse distances, 1/m, and turns inside the viewing plane, rad.
_INVERSE_DISTANCES = (0.05, 0.25, 0.7, 1.6)
_TURNS = (-0.7, 0.0, 0.7)
_BEST_STARTS = 2
_MOST_STEPS = 8
_LONGEST_STEP = 1.5
_CONVERGED = 1e-3
# Keeps the two directions that one image does not show finite; the others are seen.
_GRAVITY = np.array(STANDARD_GRAVITY)
_PRIOR = np.array([1.0, 1.0, 1e2, 1e2])


def factor_state(
    state: gtsam.NavState,
    bias: gtsam.imuBias.ConstantBias,
    delta: FloatArray,
    time_shift: float = 0.0,
) -> State:
    """A knot's state, a line and the frames' shift in time, for a factor's `evaluate`."""
    pose = state.pose().matrix()
    return State(pose, state.velocity(), bias.vector(), _GRAVITY, delta, time_shift)


# delta, whether a Jacobian is wanted -> whitened residual, Jacobian by delta
_Whitened = Callable[[FloatArray, bool], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False)
class View:
    """A line's sightings in one interval between knots."""

    motion: FrameMotion
    """Of the frames that saw it."""
    points: CompressedPoints
    state: gtsam.NavState
    """Of the knot."""
    bias: gtsam.imuBias.ConstantBias
    time_shift: float = 0.0
    """How much later than `motion` says its frames were taken, s."""

    def residual(
        self, chart: LineChart, body_T_cam: gtsam.Pose3
    ) -> Callable[[FloatArray, bool], Residual]:
        """Residual of a line in `chart` by its delta; its Jacobian has the factors' columns."""
        spec = RuledSurfaceSpec(
            form="knot",
            keys=(0, 1, 2, 3),  # of no graph
            noise_model=noiseModel.Unit.Create(self.points.rows),
            chart=chart,
            motion=self.motion,
            points=self.points,
            body_T_cam=body_T_cam,
            gravity=_GRAVITY,
        )
        compute = evaluation(spec)
        here = factor_state(self.state, self.bias, np.zeros(4), self.time_shift)
        return lambda delta, want_jacobian: compute(here._replace(line=delta), want_jacobian)


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
    world_T_cam: gtsam.Pose3,
    points: FloatArray,
    views: Sequence[View],
    body_T_cam: gtsam.Pose3,
    deviation: float,
) -> LineFit | None:
    """Least squares over a new line alone, from several distances and directions.

    Args:
        world_T_cam: camera of the first sighting, which anchors the line.
        points: seen there, (N, 2), normalised.
        views: all sightings.
        body_T_cam: camera pose in the body frame.
        deviation: of a point, normalised units.

    Returns:
        The best fit, None if the points define no line.
    """
    try:
        chart = line_from_ruling(world_T_cam, points, _INVERSE_DISTANCES[1])
    except FactorError:
        return None
    residuals = [view.residual(chart, body_T_cam) for view in views]

    def whitened(delta: FloatArray, want_jacobian: bool) -> tuple[FloatArray, FloatArray]:
        values, jacobians = [delta / _PRIOR], [np.diag(1.0 / _PRIOR)]
        for compute in residuals:
            residual = compute(delta, want_jacobian)
            values.append(residual.value / deviation)
            if residual.jacobian is not None:
                jacobians.append(residual.jacobian[:, 18:22] / deviation)
        return np.concatenate(values), np.vstack(jacobians)

    def cost(delta: FloatArray) -> float:
        value, _ = whitened(delta, False)
        return float(value @ value)

    turns = [(np.arctan(i) - chart.angle, turn) for i in _INVERSE_DISTANCES for turn in _TURNS]
    starts = [np.array([nearer, turn, 0.0, 0.0]) for nearer, turn in turns]
    starts.sort(key=cost)
    delta = min((_descend(start, whitened) for start in starts[:_BEST_STARTS]), key=cost)
    _, jacobian = whitened(delta, True)
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    inverse, slope = chart.inverse_distance(delta)
    weight = sum(view.points.weight for view in views)
    try:
        recentred, _ = chart.reanchor(delta, world_T_cam)
    except FactorError:
        return None
    sigma = float(np.sqrt(slope @ covariance @ slope))
    return LineFit(recentred, inverse, sigma, deviation * float(np.sqrt(cost(delta) / weight)))


def _descend(delta: FloatArray, whitened: _Whitened) -> FloatArray:
    """Levenberg-Marquardt."""
    damping = 1e-3
    value, jacobian = whitened(delta, True)
    cost = float(value @ value)
    for _ in range(_MOST_STEPS):
        hessian = jacobian.T @ jacobian
        damped = hessian + damping * np.diag(np.diag(hessian))
        step = -np.linalg.solve(damped, jacobian.T @ value)
        step *= min(1.0, _LONGEST_STEP / float(np.linalg.norm(step) + 1e-12))
        tried, _ = whitened(delta + step, False)
        gained = cost - float(tried @ tried)
        if gained <= 0.0:
            damping *= 10.0
            continue
        delta, cost, damping = delta + step, cost - gained, 0.2 * damping
        value, jacobian = whitened(delta, True)
        if gained < _CONVERGED * cost:
            break
    return delta
