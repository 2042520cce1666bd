# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The window's life: start, extrusion (algorithm 1), sliding (algorithm 2), and the trajectory."""

from collections import deque

import numpy as np
from scipy.spatial.transform import Rotation

from ruledgraph.baselines.paper.derotation import Derotation, Inertial
from ruledgraph.baselines.paper.start import PointDetector
from ruledgraph.baselines.paper.surfaces import Surfaces, loss, solve
from ruledgraph.baselines.paper.window import Rulings, Seen, Window
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import Frame, Gap, ImuSample, Measurement
from ruledgraph.core.output import Output
from ruledgraph.imu.buffer import ImuBuffer

LINES, FRAMES = 4, 140
# See the package's docstring for what these stand for.
_TAU = 0.01
_MAX_POINTS = 20
_LOSS, _PERTURBATION, _MAX_ATTEMPTS = 0.01, 0.03, 5
_FIRST_DISTANCE = 1.0
_FIRST_FORCE = 0.1
# An initial rest, s, and how little the gyroscope varies in it, rad/s.
_REST, _STILL = 0.5, 0.02
_MIN_LINES = 2


class PaperOdometry(Output):
    """The paper's solver behind the interface of `ruledgraph.odometry.Odometry`.

    Live estimates are the newest frame's in its window, smoothed ones the chain of the windows'
    first displacements. There are no covariances: they are NaN.
    """

    def __init__(self, calibration: Calibration) -> None:
        super().__init__()
        self.calibration = calibration
        self.window: Window | None = None
        self.status = "initializing"
        """Or the last estimate's `Status`."""
        self._detector = PointDetector(calibration.camera)
        self._imu = ImuBuffer()
        self._waiting: deque[Frame] = deque()
        self._origin: int | None = None
        self._derotation = Derotation(calibration.body_T_cam, np.zeros(3))
        self._ended = False
        self._rulings: list[Rulings] = []
        self._rng = np.random.default_rng(0)

    # -- input -----------------------------------------------------------------------------------

    def add(self, measurement: Measurement) -> None:
        """A frame, an IMU sample, or a gap, which ends the trajectory.

        Raises:
            RuledgraphError: for an image of another size than the calibration's.
        """
        if self._ended:
            return
        if isinstance(measurement, Frame):
            camera = self.calibration.camera
            if measurement.image.shape != (camera.height, camera.width):
                height, width = measurement.image.shape[:2]
                raise RuledgraphError(
                    f"a frame is {width}x{height}, but the calibration is for {camera.width}x"
                    f"{camera.height}; use the calibration of this camera and resolution"
                )
            self._waiting.append(measurement)
        elif isinstance(measurement, ImuSample):
            time = self._seconds(measurement.stamp)
            self._imu.append(time, measurement.gyroscope, measurement.accelerometer)
            while self._waiting and self._imu.latest >= max(_REST, self._time(self._waiting[0])):
                with self.timings.measured("frame"):
                    self._process(self._waiting.popleft())
        elif isinstance(measurement, Gap):
            self.finish()
            self.warnings.append(
                f"no IMU from {self._seconds(measurement.start):.2f} s: the trajectory ends there"
            )
            self._ended = True

    def finish(self) -> None:
        """Hand out what is still in the window."""
        if self.window is None:
            return
        window, self.window = self.window, None
        for frame in window.frames:
            self.put(smoothed=[self._estimate(window, frame)])
        rulings = window.rulings()
        self._rulings.append(rulings)
        self.put(lines=window.line_estimates(rulings))

    # -- output ----------------------------------------------------------------------------------

    def take_rulings(self) -> list[Rulings]:
        """The lines of the windows that were left, since the last call."""
        taken, self._rulings = self._rulings, []
        return taken

    # -- one frame -------------------------------------------------------------------------------

    def _process(self, frame: Frame) -> None:
        time = self._time(frame)
        if not self._imu.covers(time, time):
            return  # before the first IMU sample
        if self.window is None:
            self._start(frame, time)
        else:
            last = self.window.frames[-1].inertial
            if time <= last.time:
                return
            inertial = self._derotation.next(last, time, self._imu)
            with self.timings.measured("search"):
                self._extrude(self.window, frame, inertial)
            if len(self.window.frames) > FRAMES:
                self._slide(self.window)
            with self.timings.measured("solver"):
                self._solve(self.window)
        if self.window is not None:
            live = self._estimate(self.window, self.window.frames[-1])
            self.put(live=[live])
            self.status = live.status
        self._imu.forget(time)

    def _start(self, frame: Frame, time: float) -> None:
        """Lines by the Hough transform, at an assumed distance."""
        ends = self._detector.lines(frame.image, LINES)
        if len(ends) < _MIN_LINES:
            self.warnings.append(
                f"no start at {time:.2f} s: {len(ends)} lines by the Hough transform"
            )
            return
        samples = self._imu.between(time, min(time + _REST, self._imu.latest))
        is_still = samples.gyroscope.std(axis=0).max() < _STILL
        bias = samples.gyroscope.mean(axis=0) if is_still else np.zeros(3)
        early = samples.times <= time + _FIRST_FORCE
        force = samples.accelerometer[early].mean(axis=0)
        self._derotation = Derotation(self.calibration.body_T_cam, bias)
        inertial = self._derotation.first(time)
        up = force / np.linalg.norm(force)
        level = Rotation.align_vectors([0.0, 0.0, 1.0], up)[0].as_matrix()
        V0 = np.pad(ends[:, 1] - ends[:, 0], ((0, 0), (0, 1)))
        V0 /= np.linalg.norm(V0, axis=1, keepdims=True)
        X0 = _FIRST_DISTANCE * np.pad(ends[:, 0], ((0, 0), (0, 1)), constant_values=1.0)
        X0 -= np.sum(X0 * V0, axis=1, keepdims=True) * V0
        surfaces = Surfaces(X0, V0, np.zeros(3), inertial.rotation.T @ force)
        points = self._detector.points(frame.image)
        chosen = _near_lines(points, surfaces.distances(points, np.zeros(3)), self._rng)
        self.window = Window(deque([Seen(frame.stamp, inertial, chosen)]), surfaces, level)

    def _extrude(self, window: Window, frame: Frame, inertial: Inertial) -> None:
        """Algorithm 1, first half: the points near the predicted rulings."""
        points = self._detector.points(frame.image)
        seen = Seen(frame.stamp, inertial, [])
        derotated = window.derotated(points, inertial)
        distances = window.surfaces.distances(derotated, window.displacement(seen))
        seen.points.extend(_near_lines(points, distances, self._rng))
        window.frames.append(seen)

    def _slide(self, window: Window) -> None:
        """Algorithm 2: hand out the first frame, and go on from the second."""
        self.put(smoothed=[self._estimate(window, window.frames[0])])
        self._rulings.append(window.rulings())
        window.slide()

    def _solve(self, window: Window) -> None:
        """The second half of both algorithms: solve, perturb while the loss is large."""
        points, frames = window.points(), len(window.frames)
        best = solve(window.surfaces, points)
        least = loss(best, points, frames)
        attempts = 0
        while least > _LOSS and attempts < _MAX_ATTEMPTS:
            attempts += 1
            found = solve(best.perturbed(self._rng, _PERTURBATION), points)
            if (its := loss(found, points, frames)) < least:
                best, least = found, its
        if attempts:
            self.recoveries.append(
                f"{window.frames[-1].inertial.time:.2f} s: perturbed {attempts} times, "
                f"loss {least:.2g}"
            )
        window.surfaces = best

    # -- results ---------------------------------------------------------------------------------

    def _estimate(self, window: Window, frame: Seen) -> Estimate:
        unknown = np.full((6, 6), np.nan)
        return Estimate(
            stamp=frame.stamp,
            world_T_body=window.world_T_cam(frame).compose(self.calibration.body_T_cam.inverse()),
            velocity=window.world_velocity(frame),
            bias=self._derotation.bias,
            covariances=(unknown, unknown[:3, :3], unknown),
            lines=frame.lines,
            status="tracking" if frame.lines >= _MIN_LINES else "dead reckoning",
            at_state=False,
        )

    # -- bookkeeping -----------------------------------------------------------------------------

    def _seconds(self, stamp: int) -> float:
        """Time of a stamp of the IMU's clock: since the first one."""
        if self._origin is None:
            self._origin = stamp
        return (stamp - self._origin) * 1e-9

    def _time(self, frame: Frame) -> float:
        return self._seconds(frame.stamp) + self.calibration.time_offset


def _near_lines(
    points: FloatArray, distances: FloatArray, rng: np.random.Generator
) -> list[FloatArray]:
    """Points (N, 2) near each line, distances (M, N), some of them where there are many."""
    chosen = []
    for of_line in distances:
        near = np.flatnonzero(of_line < _TAU)
        if len(near) > _MAX_POINTS:
            near = rng.choice(near, _MAX_POINTS, replace=False)
        chosen.append(points[near])
    return chosen
