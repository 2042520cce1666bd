# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The factors of a line: its edge points in an interval, and the priors of a new one."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, V, X

from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.states import IntervalSightings, LineObservation, StateNode
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import Config, LinesConfig
from ruledgraph.core.line_observations import Sighting
from ruledgraph_factors import (
    NEW_LINE_SIGMAS,
    GeometricPoints,
    RuledSurfaceFactor,
    line_distance_factor,
    new_line_factor,
    ruled_surface_factor,
)


class EdgeModel(NamedTuple):
    """The camera on the body, and the noise of its edge points."""

    body_T_cam: gtsam.Pose3
    focal: float
    """Focal length, px."""
    sigma: float
    """Of a point, normalised units."""
    cauchy_scale: float
    """See `edge_noise`."""

    @classmethod
    def of(cls, calibration: Calibration, config: Config) -> "EdgeModel":
        """Of a calibrated camera."""
        focal = calibration.camera.focal_length
        sigma, scale = config.edges.sigma_px / focal, config.lines.cauchy_scale_px / focal
        return cls(calibration.body_T_cam, focal, sigma, scale)


def compressed_points(sightings: Sequence[Sighting]) -> GeometricPoints:
    """The points of several frames, for a factor."""
    return GeometricPoints(np.array([sighting.statistics for sighting in sightings]))


def edge_noise(rows: int, weight: float, sigma: float, cauchy_scale: float) -> noiseModel.Base:
    """Noise of a line's edge points in an interval.

    Args:
        rows: of the factor.
        weight: points that count.
        sigma: of one of them, normalised units.
        cauchy_scale: offset of the whole line in every frame, normalised units; 0: not robust.
    """
    noise: noiseModel.Base = noiseModel.Isotropic.Sigma(rows, sigma)
    if cauchy_scale > 0.0:
        # The whitened norm of a line that is off by so much in every frame.
        size = cauchy_scale / sigma * np.sqrt(weight)
        noise = noiseModel.Robust.Create(noiseModel.mEstimator.Cauchy.Create(size), noise)
    return noise


def observation(seen: IntervalSightings, line: Landmark, model: EdgeModel) -> LineObservation:
    """The factor of a line over the frames of an interval in which it was seen."""
    interval, index, sightings = seen
    compressed = compressed_points(sightings)
    noise = edge_noise(compressed.rows, compressed.weight, model.sigma, model.cauchy_scale)
    k = interval.node.index
    is_whole = len(index) == len(interval.stamps)
    motion = interval.motion if is_whole else interval.motion.select(list(index))
    state, rest = (X(k), V(k), B(k)), (motion, line.chart, compressed)
    offset, extrinsics, focal_ratio = interval.camera
    # The camera's own at rest, too: lines placed with a given mounting would hold it there.
    factor = ruled_surface_factor(
        noise,
        *state,
        line.key,
        *rest,
        None if extrinsics else model.body_T_cam,
        interval.gravity,
        time_key=offset.key if offset and motion.time_jacobian is not None else None,
        extrinsics_key=extrinsics.key if extrinsics else None,
        focal_key=focal_ratio.key if focal_ratio else None,
    )
    factor.weight = line.weight
    return LineObservation(line, factor, compressed, (index[-1], sightings[-1].points))


def on_variable(factor: RuledSurfaceFactor, line: Landmark) -> RuledSurfaceFactor:
    """The same on the variable and the chart that a line has now."""
    moved = RuledSurfaceFactor(factor.spec.with_line(line.key, line.chart))
    moved.weight = line.weight
    return moved


def new_line_factors(
    node: StateNode, line: Landmark, config: LinesConfig, distance: float
) -> tuple[gtsam.NonlinearFactor, ...]:
    """Priors of a line, which was seen from one position only so far.

    They are relative to the state that saw it first. Priors in the world frame would also constrain
    the unobservable position and yaw, more with every new line. `distance` (m) is the
    `usual_distance` of lines.
    """
    pose_key, pose = X(node.index), node.state.pose()
    wide = noiseModel.Diagonal.Sigmas(np.array(NEW_LINE_SIGMAS))
    of_distance = noiseModel.Isotropic.Sigma(1, math.log(config.prior_distance_factor))
    return (
        new_line_factor(wide, pose_key, line.key, line.chart, pose),
        line_distance_factor(of_distance, pose_key, line.key, line.chart, distance),
    )
