# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A line in space from two or more views, the cameras' poses being known.

The start of the least squares is linear. In the frame of the first camera, n the normal of the
viewing plane seen there and B (3, 2) a basis across it, a line near that plane is m = n + B a,
v = B w; every edge point q of a camera at (R, b) obeys q . R^T (m - b x v) = 0, which is linear in
a (the plane) and w, whose length is the inverse distance and whose direction is the line's. A line
at infinity, w = 0, and one whose cameras all stay in the plane, b x v along n, look the same: all
views show one plane. Whether they do is a likelihood-ratio test with two degrees of freedom.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import gtsam
import numpy as np
from gtsam import noiseModel
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.kernel import active_kernel, native
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.line_fit import LineMinimum, fit_line
from ruledgraph_factors.motion import FrameMotion
from ruledgraph_factors.observations import GeometricPoints
from ruledgraph_factors.ruled_surface import State
from ruledgraph_factors.ruling import NEW_LINE_SIGMAS
from ruledgraph_factors.spec import RuledSurfaceSpec
from ruledgraph_factors.validation import FloatArray, image_points, pose, positive_number

LineStatus: TypeAlias = Literal[
    "determined", "no_baseline", "within_plane", "no_parallax", "behind_camera"
]
"""Outcome of `triangulate_line`; `LineTriangulation.reason` puts it in a sentence."""

STATUSES: tuple[LineStatus, ...] = get_args(LineStatus)
"""In the order of the native kernel's."""

# Confidence that the views show more than one plane.
_CONFIDENCE = 0.999
# Motion at less than this to the viewing plane (rad) is called motion within it. Wording alone.
_WITHIN_PLANE = 0.1
# Where to start beside the linear solution: inverse distances, 1/m, and turns in the plane, rad.
_INVERSE_DISTANCES = (0.05, 0.25, 0.7, 1.6)
_TURNS = (-0.7, 0.0, 0.7)
_DESCENTS, _MAX_DESCENTS = 2, 5
_CONVERGED = 1e-3
# Costs that differ by less, relatively, are those of one minimum.
_ROUNDING = 1e-6
_PRIOR = np.array(NEW_LINE_SIGMAS) ** -2.0
# Holds the distance and the direction, leaves the plane to the points.
_PLANE_ALONE = np.array([1e12, 1e12, 0.0, 0.0])
_NO_VELOCITY, _NO_BIAS, _NO_GRAVITY = np.zeros(3), np.zeros(6), np.zeros(3)


@dataclass(frozen=True, eq=False)
class LineTriangulation:
    """A line from several views."""

    chart: LineChart
    """Anchored in the first camera; the line is at zeros(4)."""
    covariance: FloatArray
    """Of delta, (4, 4): from the points and, so that it stays finite, `NEW_LINE_SIGMAS`."""
    rms: float
    """Root mean square distance of the points from their rulings, normalised image units. Several
    times `sigma`: the points are not those of one line, or the poses are wrong."""
    status: LineStatus
    """"determined", or why the points do not determine distance and direction, delta[0] and
    delta[1]. With "no_baseline" and "within_plane" both are the prior's, 4 m and perpendicular to
    the first view; with the others the best fit."""
    reason: str
    """The same in a sentence; empty when determined."""

    @property
    def determined(self) -> bool:
        """Whether the points determine the whole line."""
        return self.status == "determined"


def triangulate_line(
    world_T_cams: Sequence[gtsam.Pose3],
    points: GeometricPoints | Sequence[ArrayLike],
    sigma: float = 1e-3,
) -> LineTriangulation:
    """Line through the edge points of two or more views: the counterpart of `triangulatePoint3`.

    Minimises sum_j |C_j m_j / |m_j,xy||^2 / sigma^2 + sum_i (delta_i / NEW_LINE_SIGMAS_i)^2 over
    the line alone by Levenberg-Marquardt, from a linear solution and from several distances and
    directions. The prior is that of a line 4 m away, perpendicular to the first view.

    Views may be of one moving camera or of several cameras. Errors of the poses are not in the
    covariance; do not use it as a prior beside factors of the same points.

    Args:
        world_T_cams: pose of the camera (optical axes) of each view; the first anchors the chart.
        points: what each view shows of the line: normalised points (N_i, 2), or compressed ones.
        sigma: standard deviation of a point across the line, normalised image units; by default
            half a pixel at a focal length of 500 px.

    Raises:
        FactorError: naming the argument that is wrong; or the points of the first view do not
            define a line in the image.

    A degenerate configuration is not an error: see `LineTriangulation.status`.

    Source: linear triangulation of Pluecker lines as in Bartoli and Sturm, "Structure-from-motion
    using lines", CVIU 2005; here the first view's plane normalises it.
    """
    cameras = [pose(f"world_T_cams[{j}]", camera) for j, camera in enumerate(world_T_cams)]
    if not isinstance(points, GeometricPoints):
        if len(points) == 0:
            raise FactorError("points is empty: at least one view is needed")
        image_points("points[0]", points[0])
        points = GeometricPoints.from_frames(points)
    if points.frames != len(cameras):
        raise FactorError(f"points has {points.frames} views, but world_T_cams has {len(cameras)}")
    points.image_line(0)  # raises where there is none
    sigma = positive_number("sigma", sigma)
    if active_kernel() == "numpy":
        return triangulate_line_in_numpy(cameras, points, sigma)
    poses = np.array([camera.matrix() for camera in cameras])
    found = native.triangulate_line(poses, points.statistics, sigma)
    basis, angle, covariance, rms, status, reason = found
    chart = LineChart(cameras[0], basis, angle)
    return LineTriangulation(chart, covariance, rms, STATUSES[status], reason)


def triangulate_line_in_numpy(
    world_T_cams: Sequence[gtsam.Pose3], points: GeometricPoints, sigma: float
) -> LineTriangulation:
    """The reference of `_native.triangulate_line`."""
    views = _Views(world_T_cams, points, 1.0 / sigma**2)
    fit = views.fit()
    chart, by_delta = views.chart.recentred(fit.delta)
    squares = fit.cost - float(_PRIOR @ fit.delta**2)
    status, reason = views.classify(chart, squares)
    if status in ("no_baseline", "within_plane"):  # what the fit made of these two is noise
        fit = views.fit_plane()
        chart, by_delta = views.chart.recentred(fit.delta)
        squares = fit.cost
    covariance = by_delta @ np.linalg.inv(fit.hessian) @ by_delta.T
    rms = float(np.sqrt(max(squares, 0.0) / points.weight)) * sigma
    return LineTriangulation(chart, 0.5 * (covariance + covariance.T), rms, status, reason)


class _Views:
    """Cameras in the frame of the first, and their points."""

    def __init__(
        self, world_T_cams: Sequence[gtsam.Pose3], points: GeometricPoints, information: float
    ) -> None:
        self.points = points
        self.information = information
        self.anchor = world_T_cams[0]
        first_T_cams = [self.anchor.between(camera) for camera in world_T_cams]
        self.rotations = np.array([c.rotation().matrix() for c in first_T_cams])
        self.centres = np.array([c.translation() for c in first_T_cams])
        self.motion = _motion(first_T_cams)
        line, middle = points.image_line(0)
        self.normal = line / np.linalg.norm(line)
        self.chart = LineChart.from_ruling(self.anchor, line, _INVERSE_DISTANCES[1], middle)

    def fit(self) -> LineMinimum:
        starts = [
            np.array([np.arctan(inverse) - self.chart.angle, turn, 0.0, 0.0])
            for inverse in _INVERSE_DISTANCES
            for turn in _TURNS
        ]
        linear = self._descend(self.chart, [self._linear()], _PRIOR, 1)
        others = self._descend(self.chart, starts, _PRIOR, _DESCENTS)
        best = others if others.cost < (1.0 - _ROUNDING) * linear.cost else linear
        for _ in range(_MAX_DESCENTS):  # each takes a few steps
            fit = self._descend(self.chart, [best.delta], _PRIOR, 1)
            gained, best = best.cost - fit.cost, fit
            if gained < _CONVERGED * fit.cost:
                break
        return best

    def fit_plane(self) -> LineMinimum:
        """Of the plane alone; distance and direction are those of the prior, and so known."""
        fit = self._descend(self.chart, [np.zeros(4)], _PLANE_ALONE, 1)
        hessian = np.diag(_PRIOR)
        hessian[2:, 2:] = fit.hessian[2:, 2:]
        return LineMinimum(fit.delta, fit.cost, hessian)

    def classify(self, chart: LineChart, squares: float) -> tuple[LineStatus, str]:
        """Verdict on a fit with this sum of squared whitened distances."""
        normal = self.normal
        across = float(np.abs(self.centres @ normal).max())
        baseline = float(np.linalg.norm(self.centres, axis=1).max())
        moved = f"the cameras move {baseline:.3g} m, {across:.3g} m of it across the line's plane"
        if baseline == 0.0:
            return "no_baseline", "all views are from one place: they show the line's plane alone"
        at_infinity = LineChart(self.anchor, chart.basis, 0.0)
        plane = self._descend(at_infinity, [np.zeros(4)], _PLANE_ALONE, 1)
        if plane.cost - squares < -2.0 * np.log(1.0 - _CONFIDENCE):
            if across < _WITHIN_PLANE * baseline:
                return "within_plane", f"{moved}: along the line, or straight towards it"
            return "no_parallax", f"{moved}: too little for a line so far away, or for the noise"
        if not self._in_front(chart):
            return "behind_camera", "the line lies behind most of the cameras that see it"
        return "determined", ""

    def _descend(
        self, chart: LineChart, starts: Sequence[FloatArray], prior: FloatArray, descents: int
    ) -> LineMinimum:
        # A factor whose frames are cameras that stand fast.
        spec = RuledSurfaceSpec(
            form="node",
            keys=(0, 1, 2, 3),  # of no graph
            noise_model=noiseModel.Unit.Create(self.points.rows),
            chart=chart,
            motion=self.motion,
            points=self.points,
            body_T_cam=gtsam.Pose3(),
            gravity=_NO_GRAVITY,
        )
        state = State(self.anchor.matrix(), _NO_VELOCITY, _NO_BIAS, _NO_GRAVITY, np.zeros(4))
        return fit_line(spec, state, starts, self.information, prior, descents)

    def _linear(self) -> FloatArray:
        """Delta of the linear solution."""
        across = self.chart.basis[:, 1:]
        cams_R_first = self.rotations.transpose(0, 2, 1)
        seen = cams_R_first @ self.normal
        size = np.maximum(np.hypot(seen[:, 0], seen[:, 1]), 1e-3)[:, None, None]
        by_moment = self.points.statistics @ cams_R_first / size
        by_direction = by_moment @ np.cross(across.T, self.centres[:, None]).transpose(0, 2, 1)
        rows = np.concatenate([by_moment @ across, by_direction], axis=2).reshape(-1, 4)
        target = -(by_moment @ self.normal).reshape(-1)
        solution = np.linalg.lstsq(rows, target, rcond=1e-9)[0]
        moment = self.normal + across @ solution[:2]
        direction = across @ solution[2:]
        rotation = self.anchor.rotation().matrix()
        direction = rotation @ direction
        moment = rotation @ moment + np.cross(self.anchor.translation(), direction)
        return self.chart.local(moment, direction)

    def _in_front(self, chart: LineChart) -> bool:
        """Whether the line has positive depth at the middle of the points of most views."""
        moment = np.cos(chart.angle) * chart.basis[:, 0]
        direction = np.sin(chart.angle) * chart.basis[:, 1]
        moments = moment - np.cross(self.centres, direction)
        middles = np.column_stack([self.points.middles(), np.ones(self.points.frames)])
        rays = np.einsum("nij,nj->ni", self.rotations, middles)
        # x = depth ray, x cross v = m: the depth has the sign of (ray cross v) . m
        depths = np.sum(np.cross(rays, direction) * moments, axis=1)
        return bool(np.median(depths) > 0.0)


def _motion(first_T_cams: Sequence[gtsam.Pose3]) -> FrameMotion:
    """Motion that brings a state without velocity to these poses, whatever the time."""
    count = len(first_T_cams)
    motion = np.zeros((count, 9))
    for row, camera in zip(motion, first_T_cams, strict=True):
        row[:3] = gtsam.Rot3.Logmap(camera.rotation())
        row[3:6] = camera.translation()
    return FrameMotion(np.arange(count, dtype=float), motion, np.zeros((count, 9, 6)), _NO_BIAS)
