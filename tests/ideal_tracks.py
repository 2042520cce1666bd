# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Tracks as a perfect edge search would leave them: a hand-held camera before a dozen segments."""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from ruledgraph.backend.start import Start
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import D435I_LIKE
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.line_observations import LineTrack, Sighting
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.simulation import SplineMotion, simulate_imu
from ruledgraph.simulation.edges import observe_segment
from ruledgraph.synchronization.frame_history import FrameTime
from ruledgraph_factors import GeometricPoints
from simulated_window import BODY_T_CAM, FOCAL_LENGTH, SEGMENTS

CALIBRATION = Calibration(
    CameraModel(640, 480, FOCAL_LENGTH, FOCAL_LENGTH, 320.0, 240.0), BODY_T_CAM, D435I_LIKE
)
# The window's four, and the same nearer, further and shifted.
MANY = np.concatenate([SEGMENTS, SEGMENTS * [0.7, 0.7, -0.7], SEGMENTS * 1.6 + [0.0, 0.3, -0.2]])


@dataclass
class IdealTracks:
    """Truth and measurements; stamps are the frames' times in ns."""

    motion: SplineMotion
    imu: ImuBuffer
    bias: np.ndarray
    times: np.ndarray
    tracks: list[LineTrack]

    @property
    def stamps(self) -> list[int]:
        return [stamp_of(time) for time in self.times]


def stamp_of(time: float) -> int:
    return round(1e9 * time)


def sighting(stamp: int, points: np.ndarray) -> Sighting:
    """As the front end makes it, without the points' scatter."""
    compressed = GeometricPoints.from_frames([points]).without_scatter()
    return Sighting(stamp, points, compressed.statistics[0])


def ideal_tracks(
    seed: int,
    motion: SplineMotion,
    rate: float = 30.0,
    duration: float = 1.6,
    bias: np.ndarray | None = None,
    segments: np.ndarray = MANY,
    pixel_noise: float = 0.5,
) -> IdealTracks:
    rng = np.random.default_rng(seed)
    bias = np.zeros(6) if bias is None else bias
    samples = simulate_imu(motion, 200.0, D435I_LIKE, rng, bias).samples
    imu = ImuBuffer()
    for time, w, f in zip(samples.times, samples.gyroscope, samples.accelerometer, strict=True):
        imu.append(float(time), w, f)
    times = np.arange(0.0, duration, 1.0 / rate)
    tracks = []
    for number, ends in enumerate(segments, start=1):
        sightings = deque(
            sighting(
                stamp_of(time),
                observe_segment(
                    motion.pose(time) * BODY_T_CAM, ends, 20, pixel_noise / FOCAL_LENGTH, rng
                ),
            )
            for time in times
        )
        tracks.append(LineTrack(number, 0.0, True, sightings))
    return IdealTracks(motion, imu, bias, times, tracks)


def start_of(
    made: IdealTracks, velocity_error: float = 0.0, time_offset: TimeOffset | None = None
) -> Start:
    """At the truth but for the velocity, m/s along each axis."""
    velocity = made.motion.velocity(0.0) + velocity_error
    return Start(
        stamp=0,
        time=0.0,
        state=gtsam.NavState(made.motion.pose(0.0), velocity),
        bias=gtsam.imuBias.ConstantBias(),
        covariance=np.diag(
            np.square([0.02, 0.02, *np.full(4, 1e-4), *np.repeat([0.1, 0.05, 0.01], 3)])
        ),
        lines={},
        time_offset=time_offset,
    )


def at_rest(duration: float) -> SplineMotion:
    times = np.linspace(0.0, duration, 8)
    return SplineMotion(times, np.zeros((8, 3)), np.tile([0.1, -0.2, 0.3], (8, 1)))


def error_of(pose: gtsam.Pose3, true: gtsam.Pose3) -> float:
    """Distance between two poses' positions, m."""
    return float(np.linalg.norm(pose.translation() - true.translation()))


def frame_times(stamps: Sequence[int], times: Iterable[float]) -> list[FrameTime]:
    """Frames by their stamps (ns) and times (s)."""
    return [FrameTime(*each) for each in zip(stamps, map(float, times), strict=True)]
