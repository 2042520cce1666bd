# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A new line in 3D from its sightings, the motion being known."""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam import noiseModel

from ruledgraph.calibration.sensors import FloatArray
from ruledgraph_factors import (
    FactorError,
    FrameMotion,
    GeometricPoints,
    LineChart,
    RuledSurfaceSpec,
    line_from_ruling,
)
from ruledgraph_factors.line_fit import fit_line
from ruledgraph_factors.ruled_surface import State

# Where to start from: inverse distances, 1/m, and turns inside the viewing plane, rad.
_INVERSE_DISTANCES = (0.05, 0.25, 0.7, 1.6)
_TURNS = (-0.7, 0.0, 0.7)
_BEST_STARTS = 2
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
    points: GeometricPoints,
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
    # A factor whose frames are cameras that stand fast.
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
    state = State(anchor.matrix(), _NO_VELOCITY, _NO_BIAS, _NO_GRAVITY, line=np.zeros(4))
    turns = [(np.arctan(i) - chart.angle, turn) for i in _INVERSE_DISTANCES for turn in _TURNS]
    starts = [np.array([nearer, turn, 0.0, 0.0]) for nearer, turn in turns]
    information = 1.0 / deviation**2
    delta, cost, hessian = fit_line(spec, state, starts, information, _PRIOR, _BEST_STARTS)
    inverse, slope = chart.inverse_distance(delta)
    basis = gtsam.Rot3(chart.basis).retract(delta[1:]).matrix()
    angle = chart.angle + delta[0]
    recentred = LineChart(anchor, basis, angle - np.pi * np.round(angle / np.pi))
    sigma = float(np.sqrt(slope @ np.linalg.solve(hessian, slope)))
    return LineFit(recentred, inverse, sigma, deviation * float(np.sqrt(cost / points.weight)))


def _motion(knot_T_frames: Sequence[gtsam.Pose3]) -> FrameMotion:
    """Motion that brings a knot without velocity to these poses, whatever the time."""
    count = len(knot_T_frames)
    motion = np.zeros((count, 9))
    for row, pose in zip(motion, knot_T_frames, strict=True):
        row[:3] = gtsam.Rot3.Logmap(pose.rotation())
        row[3:6] = pose.translation()
    return FrameMotion(np.arange(count, dtype=float), motion, np.zeros((count, 9, 6)), _NO_BIAS)
