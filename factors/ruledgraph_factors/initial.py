# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Initial values: a line from one image; lines, velocity and gravity from a first window.

The first window is solved linearly. Its rotation is known from the gyroscope, so every edge point
gives a ray q in the body frame at the window's start, and the camera's centre there is
c(t) = v t + g t^2 / 2 + G(t), with G the doubly integrated accelerometer (and the lever arm of the
camera). A line (m, d) through the ray obeys

    q . (m + d x c(t)) = 0,

which is linear in m, d x v and d x g. Its direction d comes first: it is perpendicular to the
normals of all the planes that the line spans with the camera on its way. With d known, all lines
together are one linear least-squares problem in m_1..m_M, v and g, and G makes it metric. A few
Levenberg-Marquardt steps on the geometric residual then take out the bias of the linear solution.

It is degenerate, and `DegenerateWindowError` says which of these it is, when

- fewer than two lines are given, or all are parallel: motion along them is not seen;
- the planes of fewer than two lines turn: a camera at rest, one that only rotates, or one that
  moves within those planes;
- the acceleration hardly changes: one that is constant in the start frame looks like a motion of
  any scale;
- velocity and gravity are left open all the same;
- what comes out does not explain the points, or lies behind the camera.

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
from ruledgraph_factors.motion import FrameMotion
from ruledgraph_factors.observations import CompressedPoints
from ruledgraph_factors.so3 import exp_and_right_jacobian
from ruledgraph_factors.validation import FloatArray, finite_array, instance, pose

# A plane normal has turned when its spread exceeds the noise of one normal this many times, and
# half a pixel at a focal length of 500 px.
_SIGNIFICANT_TURN = 5.0
_LEAST_TURN = 1e-3
# Directions within this angle (rad, two degrees) count as parallel.
_PARALLEL = 0.035
# No edge is located better than this, about 0.05 px at a focal length of 500 px.
_LEAST_DEVIATION = 1e-4
# The misfit of all lines together over that of every image line alone; noise gives 1.00 to 1.01.
_WORST_MISFIT = 1.5
# White noise of a consumer IMU, m/s^2/sqrt(Hz). Doubly integrated over T seconds, what a parabola
# leaves of it is 0.036 T^1.5 times as much; the acceleration has to show this many times stronger.
_IMU_NOISE = 2e-3
_LEAST_EXCITATION = 30.0
# Beyond these the result is no use as an initial value: the speed of a walk, a tenth of g.
_WORST_VELOCITY_SIGMA = 1.0
_WORST_GRAVITY_SIGMA = 1.0


def line_from_ruling(
    world_T_cam: gtsam.Pose3, points: ArrayLike, inverse_distance: float
) -> LineChart:
    """Chart of a new line from its edge points in one image and a guess of its distance.

    The image line is the total-least-squares fit; the line is taken perpendicular to the ray
    through the middle of the points, at 1 / inverse_distance from the camera's centre. Give the two
    unseen directions, delta[0] and delta[3], a wide prior in the graph.

    Args:
        world_T_cam: camera pose (optical axes), the chart's anchor.
        points: normalised image coordinates, (N, 2), at least two distinct ones.
        inverse_distance: guess, >= 0, 1/m. A factor of two wrong is no trouble.

    Raises:
        FactorError: for points that do not define a line.
    """
    xy = finite_array("points", points, (None, 2))
    line, middle = _fit_image_line("points", xy)
    return LineChart.from_ruling(world_T_cam, line, inverse_distance, middle)


@dataclass(frozen=True, eq=False)
class LineTrack:
    """The edge points of one line over a window."""

    frames: Sequence[int]
    """Which frames of the window's motion saw it, increasing."""
    points: Sequence[ArrayLike]
    """Normalised image coordinates in each of them, (N_i, 2), N_i >= 2."""


@dataclass(frozen=True, eq=False)
class WindowSolution:
    """Initial values at the window's start, in a world whose z axis points against gravity, whose
    origin is the body's and whose x axis is the body's x axis made level.
    """

    world_T_body: gtsam.Pose3
    velocity: FloatArray
    """Of the body in the world, (3,), m/s."""
    gravity: FloatArray
    """In the world, (0, 0, -|g|), m/s^2; its distance from 9.81 tells how good the solution is."""
    charts: tuple[LineChart, ...]
    """One for each track, anchored at the camera of the window's start."""
    velocity_sigma: float
    """Largest standard deviation of the velocity from the points' noise, m/s. Noise and bias of the
    IMU come on top."""
    gravity_sigma: float
    """The same of gravity, m/s^2."""


def solve_first_window(
    motion: FrameMotion,
    tracks: Sequence[LineTrack],
    body_T_cam: gtsam.Pose3 | None = None,
) -> WindowSolution:
    """Lines, velocity and gravity of a first window by linear least squares, see the module's text.

    Args:
        motion: from the window's start to all its frames, integrated with the gyroscope's bias. An
            accelerometer's bias ends up in gravity.
        tracks: of two or more lines.
        body_T_cam: camera pose in the body frame, by default identity.

    Raises:
        DegenerateWindowError: when the window does not determine them, with the reason.
        FactorError: for input of the wrong form.
    """
    instance("motion", motion, FrameMotion)
    body_T_cam = gtsam.Pose3() if body_T_cam is None else pose("body_T_cam", body_T_cam)
    if len(tracks) < 2:
        raise DegenerateWindowError(
            f"{len(tracks)} line(s) in the window: motion along a line is not seen, "
            "two that are not parallel are needed"
        )
    rays = [_Rays(i, track, motion, body_T_cam) for i, track in enumerate(tracks)]
    directions = _directions(rays)
    _require_excitation(motion, body_T_cam)
    moments, velocity, gravity = _solve_linear(rays, directions)
    charts = [
        LineChart.from_plucker(body_T_cam, m, d) for m, d in zip(moments, directions, strict=True)
    ]
    return _refine(rays, charts, motion, body_T_cam, velocity, gravity)


def _fit_image_line(name: str, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Total-least-squares line (a, b, c), a^2 + b^2 = 1, and the middle of the points."""
    if len(xy) < 2:
        raise FactorError(f"{name} has {len(xy)} point(s), a line takes two")
    middle = xy.mean(axis=0)
    _, spread, axes = np.linalg.svd(xy - middle, full_matrices=False)
    if spread[0] <= 1e-12:
        raise FactorError(f"{name} all coincide, no line runs through them alone")
    normal = np.array([-axes[0, 1], axes[0, 0]])
    return np.append(normal, -normal @ middle), middle


class _Rays:
    """One track in the body frame at the window's start."""

    def __init__(
        self, number: int, track: LineTrack, motion: FrameMotion, body_T_cam: gtsam.Pose3
    ) -> None:
        frames = np.asarray(track.frames, dtype=np.int64)
        if frames.size == 0 or frames.min() < 0 or frames.max() >= len(motion):
            raise FactorError(f"tracks[{number}].frames must lie in 0 to {len(motion) - 1}")
        if np.any(np.diff(frames) <= 0):
            raise FactorError(f"tracks[{number}].frames must increase")
        if len(track.points) != frames.size:
            raise FactorError(
                f"tracks[{number}] has {frames.size} frames, but points of {len(track.points)}"
            )
        self.motion = motion.select(list(frames))
        self.points = [
            finite_array(f"tracks[{number}].points[{i}]", p, (None, 2))
            for i, p in enumerate(track.points)
        ]
        start_R_body, _ = exp_and_right_jacobian(self.motion.preintegrated[:, :3])
        self.start_R_cam = start_R_body @ body_T_cam.rotation().matrix()
        self.known_centre = (
            self.motion.preintegrated[:, 3:6] + start_R_body @ body_T_cam.translation()
        )
        fits = [
            _fit_image_line(f"tracks[{number}].points[{i}]", p) for i, p in enumerate(self.points)
        ]
        self.index = np.repeat(np.arange(frames.size), [len(p) for p in self.points])
        homogeneous = np.column_stack([np.concatenate(self.points), np.ones(self.index.size)])
        self.rays = np.einsum("nij,nj->ni", self.start_R_cam[self.index], homogeneous)

        lines = np.array([line for line, _ in fits])
        misfit = np.sum(homogeneous * lines[self.index], axis=1)
        spare = max(self.index.size - 2 * frames.size, 1)
        self.deviation = float(np.sqrt(misfit @ misfit / spare))
        size = np.linalg.norm(lines, axis=1)
        self.normals = np.einsum("nij,nj->ni", self.start_R_cam, lines / size[:, None])
        # Variance of a normal: (deviation |n_xy|)^2 (1/s1^2 + 1/s2^2), s singular values of points.
        spread = np.array(
            [
                np.sum(
                    1.0
                    / np.linalg.svd(np.column_stack([p, np.ones(len(p))]), compute_uv=False)[:2]
                    ** 2
                )
                for p in self.points
            ]
        )
        self.normal_noise = self.deviation * float(np.sqrt(np.mean(spread / size**2)))

    def in_front(self, chart: LineChart, velocity: FloatArray, gravity: FloatArray) -> bool:
        """Whether the line lies in front of the camera at most of its points."""
        plucker, _ = chart.plucker(np.zeros(4))
        t = self.motion.elapsed[:, None]
        centre = self.known_centre + t * velocity + 0.5 * t * t * gravity
        moment = (plucker[:3] + np.cross(plucker[3:], centre))[self.index]
        # x on the ray q with x cross d = m: its depth along the ray is (q x d) . m / |q x d|^2.
        return float(np.median(np.sum(np.cross(self.rays, plucker[3:]) * moment, axis=1))) > 0.0


def _directions(rays: Sequence[_Rays]) -> list[FloatArray]:
    """Each line's direction: perpendicular to the normals of all its planes."""
    directions, turning = [], 0
    for ray in rays:
        _, spread, axes = np.linalg.svd(ray.normals, full_matrices=True)
        directions.append(np.asarray(axes[2]))
        turn = float(spread[1]) / np.sqrt(len(ray.normals)) if len(spread) > 1 else 0.0
        turning += turn > max(_SIGNIFICANT_TURN * ray.normal_noise, _LEAST_TURN)
    if turning < 2:
        raise DegenerateWindowError(
            f"the planes of {turning} line(s) turn, two are needed: the camera rests, only "
            "rotates, or moves within the planes of its lines"
        )
    stacked = np.array(directions)
    if np.linalg.svd(stacked, compute_uv=False)[1] < _PARALLEL * np.sqrt(len(stacked)):
        raise DegenerateWindowError("all lines are parallel: motion along them is not seen")
    return directions


def _require_excitation(motion: FrameMotion, body_T_cam: gtsam.Pose3) -> None:
    """Scale comes from what velocity, gravity and the lines' place cannot absorb of G(t)."""
    t = motion.elapsed - motion.elapsed[0]
    start_R_body, _ = exp_and_right_jacobian(motion.preintegrated[:, :3])
    known_centre = motion.preintegrated[:, 3:6] + start_R_body @ body_T_cam.translation()
    parabolas = np.column_stack([np.ones_like(t), t, t * t])
    rest = known_centre - parabolas @ np.linalg.lstsq(parabolas, known_centre, rcond=None)[0]
    excitation = float(np.sqrt(np.mean(np.sum(rest * rest, axis=1))))
    least = _LEAST_EXCITATION * 0.036 * _IMU_NOISE * float(t[-1]) ** 1.5
    if excitation <= least:
        raise DegenerateWindowError(
            f"the acceleration hardly changes: it moves the camera by {1e3 * excitation:.2g} mm "
            f"off a parabola, and {1e3 * least:.2g} mm are needed for the scale"
        )


def _solve_linear(
    rays: Sequence[_Rays], directions: Sequence[FloatArray]
) -> tuple[list[FloatArray], FloatArray, FloatArray]:
    """Moments (perpendicular to their directions), velocity, gravity: q.m + (q x d).c(t) = 0."""
    count = len(rays)
    bases, rows, targets = [], [], []
    for i, (ray, d) in enumerate(zip(rays, directions, strict=True)):
        basis = np.linalg.svd(d[None, :])[2][1:].T
        across = np.cross(ray.rays, d)
        t = ray.motion.elapsed[ray.index][:, None]
        block = np.zeros((len(across), 2 * count + 6))
        block[:, 2 * i : 2 * i + 2] = ray.rays @ basis
        block[:, -6:-3] = across * t
        block[:, -3:] = across * (0.5 * t * t)
        bases.append(basis)
        rows.append(block)
        targets.append(-np.sum(across * ray.known_centre[ray.index], axis=1))
    solution = np.linalg.lstsq(np.vstack(rows), np.concatenate(targets), rcond=None)[0]
    moments = [basis @ solution[2 * i : 2 * i + 2] for i, basis in enumerate(bases)]
    return moments, solution[-6:-3], solution[-3:]


def _refine(
    rays: Sequence[_Rays],
    charts: Sequence[LineChart],
    motion: FrameMotion,
    body_T_cam: gtsam.Pose3,
    velocity: FloatArray,
    gravity: FloatArray,
) -> WindowSolution:
    """Levenberg-Marquardt on lines, velocity and gravity, and the checks on what comes out."""
    pose_key, velocity_key, bias_key, gravity_key = range(4)
    line_keys = range(4, 4 + len(charts))
    bias = gtsam.imuBias.ConstantBias(motion.bias[:3], motion.bias[3:])
    held = noiseModel.Isotropic.Sigma(6, 1e-6)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.addPriorPose3(pose_key, gtsam.Pose3(), held)
    graph.addPriorConstantBias(bias_key, bias, held)
    values.insert(pose_key, gtsam.Pose3())
    values.insert(velocity_key, velocity)
    values.insert(bias_key, bias)
    values.insert(gravity_key, gravity)
    for key, ray, chart in zip(line_keys, rays, charts, strict=True):
        points = CompressedPoints.from_frames(ray.points)
        noise = noiseModel.Isotropic.Sigma(points.rows, max(ray.deviation, _LEAST_DEVIATION))
        graph.add(
            ruled_surface_factor_with_gravity_vector(
                *(noise, pose_key, velocity_key, bias_key, gravity_key, key),
                *(ray.motion, chart, points, body_T_cam),
            )
        )
        values.insert(key, np.zeros(4))
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
    except RuntimeError:
        velocity_sigma = gravity_sigma = np.inf
    if not (velocity_sigma < _WORST_VELOCITY_SIGMA and gravity_sigma < _WORST_GRAVITY_SIGMA):
        raise DegenerateWindowError(
            f"velocity and gravity are left open, by {velocity_sigma:.2g} m/s and "
            f"{gravity_sigma:.2g} m/s^2: too little motion across the lines"
        )
    misfit = np.sqrt(2.0 * graph.error(values) / sum(ray.index.size for ray in rays))
    if misfit > _WORST_MISFIT:
        raise DegenerateWindowError(
            f"the solution misses the points by {misfit:.1f} times their noise: the motion is too "
            "weak, or rotation, bias or association are wrong"
        )
    velocity, gravity = values.atVector(velocity_key), values.atVector(gravity_key)
    try:
        charts = [
            chart.reanchor(values.atVector(key), chart.world_T_anchor)[0]
            for key, chart in zip(line_keys, charts, strict=True)
        ]
    except FactorError:
        raise DegenerateWindowError("a line comes out running through the camera") from None
    for i, (ray, chart) in enumerate(zip(rays, charts, strict=True)):
        if not ray.in_front(chart, velocity, gravity):
            raise DegenerateWindowError(
                f"line {i} comes out behind the camera: the motion is too weak, or rotation, bias "
                "or association are wrong"
            )

    world_T_body = gtsam.Pose3(_level(gravity), np.zeros(3))
    return WindowSolution(
        world_T_body=world_T_body,
        velocity=world_T_body.rotation().matrix() @ velocity,
        gravity=np.array([0.0, 0.0, -float(np.linalg.norm(gravity))]),
        charts=tuple(
            LineChart(world_T_body.compose(c.world_T_anchor), c.basis, c.angle) for c in charts
        ),
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
