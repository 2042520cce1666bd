# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The last step of `solve_first_window`: all of it by least squares, and the verdict."""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph_factors.errors import DegenerateWindowError, FactorError
from ruledgraph_factors.factories import ruled_surface_factor_with_gravity_vector
from ruledgraph_factors.gravity import level_attitude
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.motion import STANDARD_GRAVITY, FrameMotion
from ruledgraph_factors.observations import GeometricPoints
from ruledgraph_factors.ruling import NEW_LINE_SIGMAS
from ruledgraph_factors.validation import FloatArray
from ruledgraph_factors.window_rays import TrackRays

# How well the gyroscope's bias is known beforehand, rad/s.
_GYROSCOPE_BIAS_SIGMA = 0.02
# Beyond these a result is no use as an initial value: misfit in units of the points' deviation,
# where noise gives 1; the others in m/s and m/s^2.
_WORST_MISFIT = 1.5
_WORST_VELOCITY_SIGMA = 0.3
_WORST_GRAVITY_SIGMA = 0.2
_WORST_GRAVITY_ERROR = 0.5


@dataclass(frozen=True, eq=False)
class WindowSolution:
    """Initial values at the window's start.

    The world's z axis points against gravity, its origin is the body's, and its x axis is the
    body's x axis (y, where x is upright) made level.
    """

    world_T_body: gtsam.Pose3
    velocity: FloatArray
    """Of the body in the world, (3,), m/s."""
    gravity: FloatArray
    """In the world, (0, 0, -|g|), m/s^2; its distance from 9.81 shows how good the solution is."""
    charts: tuple[LineChart, ...]
    """One for each track; its line is at zeros(4)."""
    bias: gtsam.imuBias.ConstantBias
    """The motion's, its gyroscope part improved as far as the window shows it."""
    velocity_sigma: float
    """Largest standard deviation of the velocity, m/s, from the noise of the points and the
    gyroscope's bias. The accelerometer's noise and bias come on top."""
    gravity_sigma: float
    """The same of gravity, m/s^2."""


def refine(
    sights: Sequence[TrackRays],
    charts: Sequence[LineChart],
    motion: FrameMotion,
    body_T_cam: gtsam.Pose3,
    velocity: FloatArray,
    gravity: FloatArray,
    sigma: float,
) -> WindowSolution:
    """Levenberg-Marquardt on everything, and the checks on what comes out."""
    pose_key, velocity_key, bias_key, gravity_key = range(4)
    line_keys = range(4, 4 + len(charts))
    bias = gtsam.imuBias.ConstantBias(motion.bias[:3], motion.bias[3:])
    bias_sigmas = np.repeat([1e-6, _GYROSCOPE_BIAS_SIGMA], 3)
    wide = noiseModel.Diagonal.Sigmas(np.array(NEW_LINE_SIGMAS))
    priors, points_graph = gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph()
    priors.addPriorPose3(pose_key, gtsam.Pose3(), noiseModel.Isotropic.Sigma(6, 1e-6))
    priors.addPriorConstantBias(bias_key, bias, noiseModel.Diagonal.Sigmas(bias_sigmas))
    values = gtsam.Values()
    values.insert(pose_key, gtsam.Pose3())
    values.insert(velocity_key, velocity)
    values.insert(bias_key, bias)
    values.insert(gravity_key, gravity)
    for key, sight, chart in zip(line_keys, sights, charts, strict=True):
        points = GeometricPoints.from_frames(sight.points)
        noise = noiseModel.Isotropic.Sigma(points.rows, sigma)
        keys = (pose_key, velocity_key, bias_key, gravity_key, key)
        points_graph.add(
            ruled_surface_factor_with_gravity_vector(
                noise, *keys, sight.motion, chart, points, body_T_cam
            )
        )
        priors.addPriorVector(key, np.zeros(4), wide)
        values.insert(key, np.zeros(4))
    graph = gtsam.NonlinearFactorGraph(priors)
    graph.push_back(points_graph)
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(50)
    # The priors are stiff: damping has to follow the diagonal to reach the other variables.
    params.setDiagonalDamping(True)
    params.setlambdaUpperBound(1e10)
    try:
        values = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
        marginals = gtsam.Marginals(graph, values)
        velocity_sigma = _largest_sigma(marginals.marginalCovariance(velocity_key))
        gravity_sigma = _largest_sigma(marginals.marginalCovariance(gravity_key))
        found = [
            chart.reanchor(values.atVector(key), chart.world_T_anchor)[0]
            for key, chart in zip(line_keys, charts, strict=True)
        ]
    except FactorError:
        raise DegenerateWindowError("a line comes out running through the camera") from None
    except RuntimeError:  # GTSAM's indeterminate linear system
        velocity_sigma = gravity_sigma = np.inf
        found = list(charts)
    if not (velocity_sigma < _WORST_VELOCITY_SIGMA and gravity_sigma < _WORST_GRAVITY_SIGMA):
        raise DegenerateWindowError(
            f"velocity and gravity are uncertain, by {velocity_sigma:.2g} m/s and "
            f"{gravity_sigma:.2g} m/s^2: too little motion across the lines"
        )
    suspicion = "the motion is too weak, or rotation, bias or association are wrong"
    misfit = np.sqrt(2.0 * points_graph.error(values) / sum(s.frame.size for s in sights))
    if misfit > _WORST_MISFIT:
        raise DegenerateWindowError(
            f"the solution misses the points by {misfit:.1f} times their deviation: {suspicion}"
        )
    velocity, gravity = values.atVector(velocity_key), values.atVector(gravity_key)
    magnitude = float(np.linalg.norm(gravity))
    if abs(magnitude + STANDARD_GRAVITY[2]) > _WORST_GRAVITY_ERROR:
        raise DegenerateWindowError(f"gravity comes out as {magnitude:.2f} m/s^2: {suspicion}")
    for i, (sight, chart) in enumerate(zip(sights, found, strict=True)):
        if not sight.in_front(chart, velocity, gravity):
            raise DegenerateWindowError(f"line {i} comes out behind the camera: {suspicion}")

    world_T_body = gtsam.Pose3(level_attitude(-gravity), np.zeros(3))
    return WindowSolution(
        world_T_body=world_T_body,
        velocity=world_T_body.rotation().matrix() @ velocity,
        gravity=np.array([0.0, 0.0, -magnitude]),
        charts=tuple(
            LineChart(world_T_body.compose(c.world_T_anchor), c.basis, c.angle) for c in found
        ),
        bias=values.atConstantBias(bias_key),
        velocity_sigma=velocity_sigma,
        gravity_sigma=gravity_sigma,
    )


def _largest_sigma(covariance: FloatArray) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
