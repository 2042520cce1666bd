# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines, velocity and gravity from a first window, for a start in motion.

The window is solved linearly. Its rotation is known from the gyroscope, so every edge point
gives a ray q in the body frame at the window's start, and the camera's centre there is
c(t) = v t + g t^2 / 2 + G(t), with G the doubly integrated accelerometer (and the lever arm of the
camera). A line (m, d) through the ray obeys

    q . (m + d x c(t)) = 0,

which is linear in m, d x v and d x g. Its direction d comes first: it is perpendicular to the
normals of all the planes that the line spans with the camera on its way. With d known, all lines
together are one linear least-squares problem in m_1..m_M, v and g, and G makes it metric. Lines so
far that their planes do not turn stay out of it. Levenberg-Marquardt on the geometric residual then
takes out the bias of the linear solution, with all lines and the gyroscope's bias.

It is degenerate, and `DegenerateWindowError` says which of these it is, when

- fewer than two lines are given, or all are parallel: motion along them is not seen;
- the planes of fewer than two lines turn: a camera at rest, one that only rotates, or one that
  moves within those planes;
- the acceleration hardly changes: one that is constant in the start frame looks like a motion of
  any scale;
- velocity and gravity are left open all the same;
- what comes out does not explain the points, has lines behind the camera, or a gravity that is not
  the Earth's.

The limits are those of a camera carried or flown among things metres away.

Source: the paper's constraint (Zhu, Burner, Aloimonos, arXiv 2512.00327, Eq. 8 to 10), in moments.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam import noiseModel
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import DegenerateWindowError, FactorError
from ruledgraph_factors.factor import ruled_surface_factor_with_gravity_vector
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.motion import STANDARD_GRAVITY, FrameMotion
from ruledgraph_factors.observations import CompressedPoints
from ruledgraph_factors.ruling import NEW_LINE_SIGMAS, fit_image_line, line_from_ruling
from ruledgraph_factors.so3 import exp_and_right_jacobian
from ruledgraph_factors.validation import (
    FloatArray,
    image_points,
    instance,
    pose,
    positive_number,
)

# The normals of a line's planes have turned when they spread this many times as far as the noise of
# one, and by half a pixel at a focal length of 500 px.
_SIGNIFICANT_TURN = 5.0
_LEAST_TURN = 1e-3
# Directions within this angle (rad, two degrees) count as parallel.
_PARALLEL = 0.035
# White noise of a consumer IMU, m/s^2/sqrt(Hz). Doubly integrated over T seconds, what a parabola
# leaves of it is 0.036 T^1.5 times as much; the acceleration has to show this many times stronger.
_IMU_NOISE = 2e-3
_LEAST_EXCITATION = 30.0
# Where a line whose planes do not turn starts, and how far beyond infinity noise may put it, 1/m.
_FAR = 0.01
_BEYOND_INFINITY = 0.05
# How well the gyroscope's bias is known beforehand, rad/s.
_GYROSCOPE_BIAS_SIGMA = 0.02
# Beyond these a result is no use as an initial value: misfit in units of the points' deviation,
# where noise gives 1; the others in m/s and m/s^2.
_WORST_MISFIT = 1.5
_WORST_VELOCITY_SIGMA = 0.3
_WORST_GRAVITY_SIGMA = 0.2
_WORST_GRAVITY_ERROR = 0.5


@dataclass(frozen=True, eq=False)
class LineTrack:
    """The edge points of one line over a window."""

    frames: Sequence[int]
    """Which frames of the window's motion saw it, increasing."""
    points: Sequence[ArrayLike]
    """Normalised image coordinates in each of them, (N_i, 2), at least two distinct ones."""


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
    """In the world, (0, 0, -|g|), m/s^2; its distance from 9.81 tells how good the solution is."""
    charts: tuple[LineChart, ...]
    """One for each track; its line is at zeros(4)."""
    bias: gtsam.imuBias.ConstantBias
    """The motion's, its gyroscope part improved as far as the window shows it."""
    velocity_sigma: float
    """Largest standard deviation of the velocity, m/s, from the noise of the points and the
    gyroscope's bias. The accelerometer's noise and bias come on top."""
    gravity_sigma: float
    """The same of gravity, m/s^2."""


def solve_first_window(
    motion: FrameMotion,
    tracks: Sequence[LineTrack],
    body_T_cam: gtsam.Pose3 | None = None,
    deviation: float = 1e-3,
) -> WindowSolution:
    """Lines, velocity and gravity of a first window by linear least squares, see the module's text.

    Args:
        motion: from the window's start to all its frames, integrated with the gyroscope's bias
            known to about 0.02 rad/s. An accelerometer's bias ends up in gravity.
        tracks: of two or more lines.
        body_T_cam: camera pose in the body frame, by default identity.
        deviation: expected of an edge point against the true ruling, blur and calibration included,
            in normalised image units; by default half a pixel at a focal length of 500 px.

    Raises:
        DegenerateWindowError: when the window does not determine them, with the reason.
        FactorError: for input of the wrong form.
    """
    instance("motion", motion, FrameMotion)
    body_T_cam = gtsam.Pose3() if body_T_cam is None else pose("body_T_cam", body_T_cam)
    positive_number("deviation", deviation)
    if len(tracks) < 2:
        raise DegenerateWindowError(
            f"{len(tracks)} line(s) in the window: motion along a line is not seen, "
            "two that are not parallel are needed"
        )
    sights = [_Sight(i, track, motion, body_T_cam, deviation) for i, track in enumerate(tracks)]
    turning = [sight for sight in sights if sight.turns]
    _require_two_directions(turning)
    _require_excitation(motion, body_T_cam)
    moments, velocity, gravity = _solve_linear(turning)
    charts = []
    for sight in sights:
        if sight.turns:
            moment = moments[turning.index(sight)]
            charts.append(LineChart.from_plucker(body_T_cam, moment, sight.direction))
        else:
            centre = sight.centres(velocity, gravity)[0]
            start_T_cam = gtsam.Pose3(gtsam.Rot3(sight.start_R_cam[0]), centre)
            charts.append(line_from_ruling(start_T_cam, sight.points[0], _FAR))
    return _refine(sights, charts, motion, body_T_cam, velocity, gravity, deviation)


def _known_motion(motion: FrameMotion, body_T_cam: gtsam.Pose3) -> tuple[FloatArray, FloatArray]:
    """Rotations of the cameras, and G(t) of their centres, in the body frame at the start."""
    start_R_body, _ = exp_and_right_jacobian(motion.preintegrated[:, :3])
    start_R_cam = start_R_body @ body_T_cam.rotation().matrix()
    return start_R_cam, motion.preintegrated[:, 3:6] + start_R_body @ body_T_cam.translation()


class _Sight:
    """One track as rays and planes in the body frame at the window's start."""

    def __init__(
        self,
        number: int,
        track: LineTrack,
        motion: FrameMotion,
        body_T_cam: gtsam.Pose3,
        deviation: float,
    ) -> None:
        name = f"tracks[{number}]"
        instance(name, track, LineTrack)
        frames = np.asarray(track.frames)
        if frames.size == 0 or frames.min() < 0 or frames.max() >= len(motion):
            raise FactorError(f"{name}.frames must lie in 0 to {len(motion) - 1}")
        if np.any(np.diff(frames) <= 0):
            raise FactorError(f"{name}.frames must increase")
        if len(track.points) != frames.size:
            raise FactorError(f"{name} has {frames.size} frames, but points of {len(track.points)}")
        self.motion = motion.select(list(frames))
        self.points = [image_points(f"{name}.points[{i}]", p) for i, p in enumerate(track.points)]
        self.start_R_cam, self.known_centres = _known_motion(self.motion, body_T_cam)
        self.frame = np.repeat(np.arange(frames.size), [len(p) for p in self.points])
        homogeneous = np.column_stack([np.concatenate(self.points), np.ones(self.frame.size)])
        self.rays = np.einsum("nij,nj->ni", self.start_R_cam[self.frame], homogeneous)

        normals, precisions = [], []
        for i, points in enumerate(self.points):
            line, _ = fit_image_line(f"{name}.points[{i}]", points)
            size = np.linalg.norm(line)
            normals.append(self.start_R_cam[i] @ line / size)
            # Deviation of a normal: deviation |n_xy| sqrt(1/s1^2 + 1/s2^2), s singular values.
            s = np.linalg.svd(np.column_stack([points, np.ones(len(points))]), compute_uv=False)
            precisions.append(size / (deviation * np.hypot(1.0 / s[0], 1.0 / s[1])))
        weights = np.array(precisions)
        _, spread, axes = np.linalg.svd(weights[:, None] * np.array(normals), full_matrices=True)
        self.direction: FloatArray = np.asarray(axes[2])
        turn = float(spread[1]) if len(spread) > 1 else 0.0
        self.turns = turn > _SIGNIFICANT_TURN * np.sqrt(
            len(weights)
        ) and turn > _LEAST_TURN * np.linalg.norm(weights)

    def centres(self, velocity: FloatArray, gravity: FloatArray) -> FloatArray:
        """Camera centre in every frame, (n, 3)."""
        t = self.motion.elapsed[:, None]
        return np.asarray(self.known_centres + t * velocity + 0.5 * t * t * gravity)

    def in_front(self, chart: LineChart, velocity: FloatArray, gravity: FloatArray) -> bool:
        """Whether the line lies in front of the camera, or near infinity, at most points."""
        plucker, _ = chart.plucker(np.zeros(4))
        direction, _ = chart.direction(np.zeros(4))
        moments = plucker[:3] + np.cross(plucker[3:], self.centres(velocity, gravity))
        # x on the ray q with x cross v = m: 1 / depth = |q x d|^2 |v| / (q x d) . m, d = v / |v|.
        across = np.cross(self.rays, direction)
        share = np.sum(across * moments[self.frame], axis=1) / np.sum(across**2, axis=1)
        inverse_depth = float(np.median(plucker[3:] @ direction / share))
        return inverse_depth > -_BEYOND_INFINITY


def _require_two_directions(turning: Sequence[_Sight]) -> None:
    if len(turning) < 2:
        raise DegenerateWindowError(
            f"the planes of {len(turning)} line(s) turn, two are needed: the camera rests, only "
            "rotates, or moves within the planes of its lines"
        )
    directions = np.array([sight.direction for sight in turning])
    if np.linalg.svd(directions, compute_uv=False)[1] < _PARALLEL * np.sqrt(len(turning)):
        raise DegenerateWindowError("all lines are parallel: motion along them is not seen")


def _require_excitation(motion: FrameMotion, body_T_cam: gtsam.Pose3) -> None:
    """Scale comes from what velocity, gravity and the lines' place cannot absorb of G(t)."""
    t = motion.elapsed - motion.elapsed[0]
    _, known_centres = _known_motion(motion, body_T_cam)
    parabolas = np.column_stack([np.ones_like(t), t, t * t])
    rest = known_centres - parabolas @ np.linalg.lstsq(parabolas, known_centres, rcond=None)[0]
    excitation = float(np.sqrt(np.mean(np.sum(rest * rest, axis=1))))
    least = _LEAST_EXCITATION * 0.036 * _IMU_NOISE * float(t[-1]) ** 1.5
    if excitation <= least:
        raise DegenerateWindowError(
            f"the acceleration hardly changes: it moves the camera by {1e3 * excitation:.2g} mm "
            f"off a parabola, and {1e3 * least:.2g} mm are needed for the scale"
        )


def _solve_linear(
    sights: Sequence[_Sight],
) -> tuple[list[FloatArray], FloatArray, FloatArray]:
    """Moments (perpendicular to their directions), velocity, gravity: q.m + (q x d).c(t) = 0."""
    count = len(sights)
    bases, rows, targets = [], [], []
    for i, sight in enumerate(sights):
        basis = np.linalg.svd(sight.direction[None, :])[2][1:].T
        across = np.cross(sight.rays, sight.direction)
        t = sight.motion.elapsed[sight.frame][:, None]
        block = np.zeros((len(across), 2 * count + 6))
        block[:, 2 * i : 2 * i + 2] = sight.rays @ basis
        block[:, -6:-3] = across * t
        block[:, -3:] = across * (0.5 * t * t)
        bases.append(basis)
        rows.append(block)
        targets.append(-np.sum(across * sight.known_centres[sight.frame], axis=1))
    solution = np.linalg.lstsq(np.vstack(rows), np.concatenate(targets), rcond=None)[0]
    moments = [basis @ solution[2 * i : 2 * i + 2] for i, basis in enumerate(bases)]
    return moments, solution[-6:-3], solution[-3:]


def _refine(
    sights: Sequence[_Sight],
    charts: Sequence[LineChart],
    motion: FrameMotion,
    body_T_cam: gtsam.Pose3,
    velocity: FloatArray,
    gravity: FloatArray,
    deviation: float,
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
        points = CompressedPoints.from_frames(sight.points)
        noise = noiseModel.Isotropic.Sigma(points.rows, deviation)
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
            f"velocity and gravity are left open, by {velocity_sigma:.2g} m/s and "
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

    world_T_body = gtsam.Pose3(_level(gravity), np.zeros(3))
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


def _level(gravity: FloatArray) -> gtsam.Rot3:
    """world_R_body with gravity along -z and the body's x axis (or y, if x is upright) level."""
    up = -gravity / np.linalg.norm(gravity)
    axis = np.eye(3)[0] if abs(up[0]) < 0.9 else np.eye(3)[1]
    x = axis - up * (up @ axis)
    x = x / np.linalg.norm(x)
    return gtsam.Rot3(np.stack([x, np.cross(up, x), up]))
