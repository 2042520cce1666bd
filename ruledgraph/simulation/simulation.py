# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated recording: a scene, a motion, a camera and an IMU."""

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.calibration.imu_noise import D435I_LIKE, ImuNoise
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.measurements import Frame, ImuSample
from ruledgraph.simulation.camera_rays import Image
from ruledgraph.simulation.exposure import ImageQuality, Sensor
from ruledgraph.simulation.imu import ImuSource, RecordedImu, SyntheticImu
from ruledgraph.simulation.inertial_motion import InertialMotion
from ruledgraph.simulation.measured import MeasuredMotion
from ruledgraph.simulation.motion import Motion
from ruledgraph.simulation.motions import make_motion
from ruledgraph.simulation.renderer import Renderer
from ruledgraph.simulation.rolling_shutter import row_weights, rows_with_weight
from ruledgraph.simulation.scene import Scene
from ruledgraph.simulation.scenes import make_scene

D435I = Calibration(
    CameraModel(640, 480, 385.2, 384.9, 320.3, 238.6),
    gtsam.Pose3(gtsam.Rot3.RzRyRx(0.004, -0.006, 0.003), np.array([0.0055, -0.0051, -0.0117])),
    D435I_LIKE,
    line_delay=0.0,
)
"""Like an Intel RealSense D435i: its rectified infrared camera at 640 x 480, and its IMU."""

# A frame is rendered so often that most of the image moves less than this from one time to the
# next, px.
_BLUR_STEP = 1.5
_MAX_EXPOSURES = 16
# The same of a rolling shutter: between two renderings edges are at most so far apart, px, that
# their mean looks like one edge.
_ROLLING_STEP = 0.75
_MAX_STEPS = 100
# Stamp of the start of a named motion, ns.
_EPOCH = 1_700_000_000_000_000_000


class TrueStates(NamedTuple):
    """The body at n stamps of the IMU's clock."""

    stamps: NDArray[np.int64]
    """(n,), ns."""
    rotation: FloatArray
    """World from body, (n, 3, 3)."""
    position: FloatArray
    """Body origin in the world, (n, 3), m."""
    velocity: FloatArray
    """In the world, (n, 3), m/s."""
    bias: FloatArray
    """Of the IMU: accelerometer (m/s^2), gyroscope (rad/s), (n, 6)."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """A recording that is made while it is read; the same each time. `simulate` makes one."""

    scene: Scene
    motion: Motion
    calibration: Calibration
    """Stamps of frames are `time_offset` earlier than the IMU's of the same moment; with a
    `line_delay` they are of the first row."""
    rate: float
    """Frames a second."""
    imu: ImuSource
    quality: ImageQuality
    seed: int
    epoch: int
    """Stamp of the motion's time zero, IMU's clock, ns."""

    def stream(self) -> Iterator[Frame | ImuSample]:
        """All measurements, ordered by their stamps."""
        return heapq.merge(self.imu.samples(), self.frames(), key=lambda m: m.stamp)

    def frames(self, numbers: Iterable[int] | None = None) -> Iterator[Frame]:
        """The camera's part of the stream, or some of its frames."""
        camera = _Camera(self)
        times = self.frame_times()
        for number in range(len(times)) if numbers is None else numbers:
            if not camera.sensor.drops(number):
                time = float(times[number])
                stamp = int(self.stamps(time - self.calibration.time_offset))
                yield Frame(stamp, camera.take(number, time))

    def frame_times(self) -> FloatArray:
        """Of all frames, dropped ones included: the middle of their exposure, of a rolling shutter
        that of the first row, s.

        The first is half a frame after the motion's start.
        """
        count = int(np.floor((self.motion.stop - self.motion.start) * self.rate + 1e-6))
        return np.asarray(self.motion.start + (np.arange(count) + 0.5) / self.rate)

    def stamps(self, times: ArrayLike) -> NDArray[np.int64]:
        """Times of the motion, s, as stamps of the IMU's clock, ns."""
        return np.round(np.asarray(times) * 1e9).astype(np.int64) + self.epoch

    def truth(self, stamps: ArrayLike) -> TrueStates:
        """The true states at any stamps (n,) of the IMU's clock."""
        at = np.atleast_1d(np.asarray(stamps, dtype=np.int64))
        times = (at - self.epoch) * 1e-9
        return TrueStates(
            at,
            self.motion.rotation(times),
            self.motion.position(times),
            self.motion.velocity(times),
            self.imu.bias_at(at),
        )

    @property
    def ground_truth(self) -> TrueStates:
        """The true states at the frames' moments, in the IMU's clock."""
        return self.truth(self.stamps(self.frame_times()))

    @property
    def lines(self) -> FloatArray:
        """End points of the scene's lines in the world, (M, 2, 3), m; `line_names` names them."""
        return self.scene.lines

    @property
    def line_names(self) -> tuple[str, ...]:
        """Of the lines."""
        return self.scene.line_names


class _Camera:
    """Takes the frames of a simulation."""

    def __init__(self, simulation: Simulation) -> None:
        self._motion, self._quality = simulation.motion, simulation.quality
        self._body_T_cam = simulation.calibration.body_T_cam
        self._readout = simulation.calibration.readout
        self._camera = simulation.calibration.camera
        self._renderer = Renderer(simulation.scene, self._camera)
        self.sensor = Sensor(self._camera, simulation.quality, simulation.seed)
        # As a measure of the distance of what is seen.
        self._lines = simulation.scene.lines.reshape(-1, 3)

    def take(self, number: int, time: float) -> NDArray[np.uint8]:
        """The frame exposed around a time, s."""
        return self.sensor.develop(self._brightness(time), number, time)

    def _brightness(self, time: float) -> Image:
        half = 0.5 * self._quality.exposure
        if self._readout:
            return self._row_by_row(time)
        count = self._exposures(time - half, time + half)
        # Midpoints of equal parts of the exposure.
        moments = time + half * ((2.0 * np.arange(count) + 1.0) / count - 1.0)
        images = [self._renderer.render(self._pose(moment)) for moment in moments]
        total = images[0]
        for image in images[1:]:
            total += image
        return total * np.float32(1.0 / count)

    def _row_by_row(self, time: float) -> Image:
        """As `_brightness`, the first row around a time (s), the last `_readout` later."""
        exposure, height = self._quality.exposure, self._camera.height
        first, last = time - 0.5 * exposure, time + self._readout + 0.5 * exposure
        steps = np.ceil(self._movement(first, last) / _ROLLING_STEP)
        moments = np.linspace(first, last, 1 + int(np.clip(steps, 1, _MAX_STEPS)))
        row_times = time + np.linspace(0.0, self._readout, height)
        weights = row_weights(row_times, moments, exposure)
        total = np.zeros((height, self._camera.width), dtype=np.float32)
        for moment, share in zip(moments.tolist(), weights.astype(np.float32).T, strict=True):
            rows = rows_with_weight(share)
            # The motion ends, and with it the IMU: later rows of the last frame are of no use.
            image = self._renderer.render(self._pose(min(moment, self._motion.stop)), rows)
            total[rows] += share[rows, None] * image[rows]
        return total

    def _pose(self, time: float) -> gtsam.Pose3:
        return self._motion.pose(time) * self._body_T_cam

    def _exposures(self, start: float, stop: float) -> int:
        """How many renderings make a smooth blur."""
        pixels = self._movement(start, stop)
        return int(np.clip(np.ceil(pixels / _BLUR_STEP), 1, _MAX_EXPOSURES))

    def _movement(self, start: float, stop: float) -> float:
        """How far most of the image moves from one time to another (s), px; from how far the
        scene's lines do.
        """
        if stop <= start:
            return 0.0
        first, last = self._pose(start), self._pose(stop)
        seen = [
            (self._lines - pose.translation()) @ pose.rotation().matrix() for pose in (first, last)
        ]
        ahead = (seen[0][:, 2] > 0.2) & (seen[1][:, 2] > 0.2)
        rays = [points[ahead, :2] / points[ahead, 2:] for points in seen]
        in_view = np.all(np.abs(rays[0]) < 1.0, axis=1)
        if not in_view.any():
            return 0.0
        moved = np.quantile(np.linalg.norm(rays[1][in_view] - rays[0][in_view], axis=1), 0.9)
        return float(moved) * self._camera.focal_length


def simulate(
    scene: str | Scene,
    motion: str | Motion,
    *,
    calibration: Calibration = D435I,
    rate: float = 90.0,
    imu_rate: float = 200.0,
    imu: ImuNoise | RecordedImu | None = D435I_LIKE,
    quality: ImageQuality | None = None,
    duration: float = 12.0,
    moving_start: bool = False,
    seed: int = 0,
) -> Simulation:
    """Simulate a recording.

    Args:
        scene: one of `SCENES` or a scene of your own. The named `room` and `hall` are built around
            a motion of your own.
        motion: one of `MOTIONS` or a motion of your own, such as a `MeasuredMotion`.
        calibration: camera, IMU and how they are mounted. The simulation's own calibration has the
            noise figures of `imu`.
        rate: frames a second.
        imu_rate: samples a second, of a simulated IMU.
        imu: noise of a simulated IMU, None for one without noise and bias, or what a real IMU
            recorded along a measured motion.
        quality: of the images, by default that of a good camera in a dim room.
        duration: of a named motion, s.
        moving_start: a named motion starts at full speed instead of one second of rest.
        seed: of all randomness.

    Raises:
        RuledgraphError: for a name that is not known or a figure out of its range.
    """
    for name, value in (("rate", rate), ("imu_rate", imu_rate)):
        if not (np.isfinite(value) and value > 0.0):
            raise RuledgraphError(f"{name} = {value} Hz is not positive")
    quality = ImageQuality() if quality is None else quality
    if quality.exposure > 1.0 / rate:
        raise RuledgraphError(
            f"an exposure of {quality.exposure} s does not fit between frames at {rate} Hz"
        )
    if calibration.readout > 1.0 / rate:
        raise RuledgraphError(
            f"a readout of {calibration.readout:g} s does not fit between frames at {rate:g} Hz"
        )
    surrounds = None
    if isinstance(motion, str):
        body_R_cam = calibration.body_T_cam.rotation().matrix()
        motion = make_motion(motion, body_R_cam, duration, moving_start, seed)
    else:
        surrounds = motion
    source: ImuSource
    if isinstance(imu, RecordedImu):
        motion, source = _as_felt(motion, imu, calibration.imu_noise)
    if isinstance(scene, str):
        scene = make_scene(scene, seed, surrounds)
    epoch = motion.epoch if isinstance(motion, MeasuredMotion | InertialMotion) else _EPOCH
    if not isinstance(imu, RecordedImu):
        source = SyntheticImu(motion, imu_rate, imu, seed, epoch)
    if isinstance(imu, ImuNoise):
        calibration = replace(calibration, imu_noise=imu)
    return Simulation(scene, motion, calibration, rate, source, quality, seed, epoch)


def _as_felt(
    motion: Motion, imu: RecordedImu, noise: ImuNoise
) -> tuple[InertialMotion, RecordedImu]:
    """A measured motion as a real IMU felt it, and the IMU with the bias that this shows.

    Raises:
        RuledgraphError: when the motion was not measured or the IMU was silent during it.
    """
    if not isinstance(motion, MeasuredMotion):
        raise RuledgraphError("a recorded IMU goes with a measured motion alone")
    measured = motion.trajectory
    part = imu.between(int(measured.stamps[0]), int(measured.stamps[-1]))
    felt = InertialMotion(measured, part.stamps, part.integrable(), noise)
    return felt, part.with_bias(felt.bias_stamps, felt.bias)
