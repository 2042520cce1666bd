# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a window is made of: states, and the frames and observations between them."""

from dataclasses import dataclass, field
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, V, X

from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.self_calibration import AS_CALIBRATED, CameraVariables
from ruledgraph.calibration.imu_noise import ImuNoise
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import IntegrityConfig
from ruledgraph.core.estimates import Covariances, blocks
from ruledgraph.core.line_observations import LineTrack, Sighting
from ruledgraph_factors import (
    FrameMotion,
    GeometricPoints,
    RuledSurfaceFactor,
)
from ruledgraph_factors.ruled_surface import State

_UNIT = noiseModel.Unit.Create(15)


@dataclass(eq=False)
class StateNode:
    """A state of the graph."""

    index: int
    time: float
    state: gtsam.NavState
    bias: gtsam.imuBias.ConstantBias
    covariance: FloatArray
    """Marginal of pose, velocity and bias, (15, 15), as of when the state was new; computed anew
    when it leaves the window, when a start is accepted and when the segment ends. A state at rest
    that was not solved for has that of the state before it."""

    @property
    def covariances(self) -> Covariances:
        """Of pose (6, 6), velocity (3, 3) and bias (6, 6)."""
        return blocks(self.covariance)

    def is_plausible(self, limits: IntegrityConfig) -> bool:
        """Whether velocity and biases are within their limits."""
        return bool(
            np.linalg.norm(self.state.velocity()) < limits.max_speed
            and np.linalg.norm(self.bias.gyroscope()) < limits.max_gyroscope_bias
            and np.linalg.norm(self.bias.accelerometer()) < limits.max_accelerometer_bias
        )


@dataclass(eq=False)
class LineObservation:
    """A line in an interval."""

    line: Landmark
    factor: RuledSurfaceFactor
    points: GeometricPoints
    last: tuple[int, FloatArray]
    """Index of the last frame that saw it, and the points there."""
    in_graph: bool = True
    """Whether the factor is in the graph, see `LineGraphBuilder.observe`."""


@dataclass(eq=False)
class Interval:
    """The frames after a state, up to and including the next state's."""

    node: StateNode
    stamps: list[int]
    """Of its frames, ns."""
    motion: FrameMotion
    gravity: FloatArray
    """In the world, (3,), m/s^2."""
    noise: ImuNoise
    """Of its IMU factor: with scale errors, and a jump of the biases."""
    imu_factor: gtsam.CombinedImuFactor
    reliable_frames: int
    """How many of its frames come before the IMU is unreliable; later poses are guesses."""
    repeats_frame: bool = False
    """Whether its first frame is the state's own, the last one of the interval before, whose pose
    was a guess there."""
    last_is_repeated: bool = False
    """Whether its last frame is the first one of the interval after, too."""
    camera: CameraVariables = AS_CALIBRATED
    """What is estimated of the camera in its frames."""
    still: bool = False
    """Whether the body rested all the time, and for some time before."""
    rest_factors: list[gtsam.NonlinearFactor] = field(default_factory=list)
    """Of a rest, on the state before or after it, see `rest_factors`."""
    observations: list[LineObservation] = field(default_factory=list)
    compared: int = 0
    """Lines that were compared with their points while the interval was the newest one ..."""
    misfits: int = 0
    """... and how many of these did not fit."""
    _cached_poses: tuple[gtsam.NavState, list[gtsam.Pose3]] | None = None
    _cached_cameras: tuple[list[gtsam.Pose3], list[gtsam.Pose3]] | None = None

    @property
    def is_reliable(self) -> bool:
        """Whether the IMU was reliable all the time."""
        return self.reliable_frames == len(self.stamps)

    @property
    def residual_offset(self) -> float:
        """Estimate of T(k), see `TimeOffsetVariable`, s: frames are so much later than in
        `motion`.
        """
        offset = self.camera.time_offset
        return 0.0 if offset is None else offset.value

    @property
    def _time_shift(self) -> float:
        """The same for `motion`: zero at rest, where frames are not shifted in time."""
        return 0.0 if self.motion.time_jacobian is None else self.residual_offset

    @property
    def focal_ratio(self) -> float:
        """Estimate of F(k), see `FocalRatioVariable`; 1 when that is not estimated."""
        ratio = self.camera.focal_ratio
        return 1.0 if ratio is None else ratio.value

    @property
    def is_rest_despite_imu(self) -> bool:
        """Whether the body rested, and the IMU is unreliable or its biases jumped."""
        return self.still and not self.is_reliable

    def poses(self) -> list[gtsam.Pose3]:
        """world_T_body of its frames, computed anew when the node's state is replaced."""
        if self.is_rest_despite_imu:
            return [self.node.state.pose()] * len(self.stamps)
        cached, node = self._cached_poses, self.node
        if cached is None or cached[0] is not node.state:
            poses = self.motion.poses(
                node.state, node.bias, self.gravity, time_shift=self._time_shift
            )
            cached = self._cached_poses = node.state, poses
        return cached[1]

    def cameras(self, body_T_cam: gtsam.Pose3) -> list[gtsam.Pose3]:
        """world_T_cam of its frames: `poses` with the camera's pose in the body, which is
        `body_T_cam` where it is not estimated.
        """
        bodies, cameras = self.poses(), self._cached_cameras
        if self.camera.extrinsics is not None:
            body_T_cam = self.camera.extrinsics.body_T_cam
        if cameras is None or cameras[0] is not bodies:
            cameras = self._cached_cameras = bodies, [pose.compose(body_T_cam) for pose in bodies]
        return cameras[1]

    def state(self, delta: FloatArray) -> State:
        """What the factor of a line at `delta` depends on."""
        pose, velocity = self.node.state.pose().matrix(), self.node.state.velocity()
        bias = self.node.bias.vector()
        extrinsics, ratio = self.camera.extrinsics, self.focal_ratio
        camera = None if extrinsics is None else extrinsics.body_T_cam.matrix()
        return State(pose, velocity, bias, self.gravity, delta, self._time_shift, camera, ratio)

    def sightings_of(self, track: LineTrack) -> "IntervalSightings":
        """Of a line, in the reliable frames."""
        sightings = track.sightings
        hits: list[Sighting] = []
        for sighting in reversed(sightings):
            if sighting.stamp < self.stamps[0]:
                break
            hits.append(sighting)
        index = {stamp: i for i, stamp in enumerate(self.stamps[: self.reliable_frames])}
        hits = [sighting for sighting in reversed(hits) if sighting.stamp in index]
        return IntervalSightings(self, [index[sighting.stamp] for sighting in hits], hits)


class IntervalSightings(NamedTuple):
    """Sightings of a line in an interval."""

    interval: Interval
    frames: list[int]
    """Indices of the interval's frames that saw it."""
    sightings: list[Sighting]
    """In each of them."""


def insert_state(values: gtsam.Values, node: StateNode) -> None:
    """A state's variables: X, V and B of its index."""
    values.insert(X(node.index), node.state.pose())
    values.insert(V(node.index), node.state.velocity())
    values.insert(B(node.index), node.bias)


def joint_prior(node: StateNode) -> gtsam.NonlinearFactor:
    """A prior on pose, velocity and bias of a state with their joint covariance."""
    keys, values = (X(node.index), V(node.index), B(node.index)), gtsam.Values()
    insert_state(values, node)
    root = np.linalg.cholesky(np.linalg.inv(node.covariance)).T
    blocks = [np.asfortranarray(root[:, part]) for part in (slice(6), slice(6, 9), slice(9, 15))]
    (x, v, b), (A, C, D) = keys, blocks
    factor = gtsam.JacobianFactor(x, A, v, C, b, D, np.zeros(15), _UNIT)
    return gtsam.LinearContainerFactor(factor, values)
