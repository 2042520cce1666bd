# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The odometry: measurements in, estimates out. This file names the stages and their order."""

from collections.abc import Iterable, Iterator

from ruledgraph.backend.sliding_window import Window
from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Estimate, Status
from ruledgraph.core.measurements import Frame, Gap, ImuSample, Measurement
from ruledgraph.core.output import Output
from ruledgraph.core.time_offset import TimeOffset
from ruledgraph.frontend.front_end import FrontEnd, Predicted
from ruledgraph.frontend.ruling_prediction import CameraMotion
from ruledgraph.frontend.tracks import Tracker
from ruledgraph.imu.camera_clock import CameraClock
from ruledgraph.imu.frame_history import EARLY, FrameTime
from ruledgraph.imu.propagation import rotation_between
from ruledgraph.imu.synchronizer import Synchronizer, image_fault
from ruledgraph.initialization.clock_search import ClockSearch
from ruledgraph.initialization.initializer import Initializer
from ruledgraph.initialization.trial import Trial
from ruledgraph.integrity.rest import RestDetector
from ruledgraph.integrity.segment import Stages, TrajectorySegment
from ruledgraph.integrity.segments import Drift, Ended, continued

# Measurements are kept this much longer than the window, s: more than a late frame needs.
_SPARE = 0.5


class Odometry(Output):
    """Visual-inertial odometry from lines.

    Feed it in order of time with `add`, or `add_imu` and `add_image`; a frame is processed when the
    IMU has reached its time. Take out what has come with the `take_` methods; call `finish` at the
    end. Live estimates after a start in motion wait until it is confirmed, some tenths of a second.
    """

    def __init__(self, calibration: Calibration, config: Config | None = None) -> None:
        super().__init__()
        self.calibration = calibration
        config = config or Config()
        if calibration.time_offset_exact:
            exact = config.time_offset.model_copy(update={"estimate": False})
            config = config.model_copy(update={"time_offset": exact})
        self.config = config
        sensors = Synchronizer(calibration, self.warnings, config.imu)
        front_end = FrontEnd(calibration.camera, config.edges, config.tracks, self.timings)
        rest = RestDetector(sensors, front_end.image_motion, config.rest)
        clock = CameraClock(sensors, calibration.time_offset, config.time_offset, self.warnings)
        self._stages = Stages(sensors, front_end, rest, clock, self)
        self._initializer = Initializer(calibration, config, self._stages)
        self.clock_search = ClockSearch(calibration, config, self.warnings)
        """Of the time offset, by how the images turn."""
        self._segment: TrajectorySegment | None = None
        self._trial: Trial | None = None
        self._segments = 0
        self.last_believed: Ended | None = None
        """The last that was known before the segment; the next one begins there."""
        self.status: Status = "tracking"
        """Of the last frame."""

    @property
    def tracker(self) -> Tracker:
        """The lines in the image."""
        return self._stages.front_end.tracker

    @property
    def window(self) -> Window | None:
        """The lines and states of the graph; None before a start."""
        return None if self._segment is None else self._segment.window

    @property
    def refusal(self) -> str:
        """Why the last attempt to start failed; empty after a start."""
        return self._initializer.refusal

    @property
    def time_offset(self) -> TimeOffset:
        """t_imu - t_cam, s, as last known; without deviation when it is not estimated."""
        return self._stages.clock.offset

    # -- input -----------------------------------------------------------------------------------

    def add(self, measurement: Measurement) -> None:
        """A frame, an IMU sample, or a gap, which ends a segment."""
        if isinstance(measurement, Frame):
            self.add_image(measurement)
        elif isinstance(measurement, ImuSample):
            self.add_imu(measurement)
        else:
            self._break(measurement)

    def add_imu(self, sample: ImuSample) -> None:
        """An IMU sample; the frames up to its time are processed."""
        sensors = self._stages.sensors
        gap = sensors.add_imu(sample)
        if gap is not None:
            self._break(gap)
            sensors.add_imu(sample)
        while (frame := sensors.next_frame()) is not None:
            with self.timings.measured("frame"):
                self._process(frame)

    def add_image(self, frame: Frame) -> None:
        """A grey image of the calibration's size.

        Raises:
            RuledgraphError: for another image.
        """
        self._stages.sensors.add_image(frame)

    def prefetch(self, frame: Frame) -> None:
        """Begin with what will be needed of a frame that will be added, to save time then.

        May be called from another thread, for each frame in order. What is wrong with a frame is
        said when it is added.
        """
        if not image_fault(frame, self.calibration.camera):
            self._stages.front_end.prefetch(frame)

    def finish(self) -> None:
        """Hand out what is still in the window."""
        if self._segment is not None:
            self._segment.finish()
            self.last_believed = self._segment.ended
        self._segment = self._trial = None

    # -- one frame -------------------------------------------------------------------------------

    def _process(self, frame: Frame) -> None:
        sensors, front_end = self._stages.sensors, self._stages.front_end
        now = sensors.timed(frame)
        if now is None:
            return
        front_end.start_tracks()
        self._look_for_gap(now.time)
        segment, rate = self._segment, self.config.tracks.detection_interval
        due = segment is not None and segment.is_state_due(now.time)
        if segment is not None:
            rate = segment.detect_every(rate)
        # At a state it costs little time: the smoother works meanwhile.
        detect_every = rate - EARLY if due or segment is None else None
        found = front_end.process(frame, now.time, self._predicted(now), detect_every)
        lines = 0 if self.window is None else sum(id_ in self.window.lines for id_ in found)
        sensors.frames.append(now)
        if segment is None or self.status != "still":
            with self.timings.measured("clock"):
                self.clock_search.add_image(sensors.seconds(frame.stamp), frame.image)
        if segment is None:
            with self.timings.measured("start"):
                due = self._try_start(now)
        elif due:
            with self.timings.measured("smoother"):
                segment.advance()
            if not self._holds(segment, now) or self._search_clock(now.time):
                return
        if self._segment is not None:
            self.status = self._segment.report(now, lines, due)
        keep = now.time - max(self.config.start.window, self.config.window.lag) - _SPARE
        sensors.frames.forget(keep)
        sensors.imu.forget(keep)
        front_end.drop_lost(sensors.frames.first.stamp)

    def _predicted(self, now: FrameTime) -> Predicted | None:
        """The camera's motion since the last frame, and the lines of the graph."""
        sensors, body_T_cam = self._stages.sensors, self.calibration.body_T_cam
        if not sensors.frames:
            return None
        before = sensors.frames.last
        elapsed = now.time - before.time
        if self._segment is None:
            body_R_cam = body_T_cam.rotation()
            before_R_body = rotation_between(sensors.imu, before.time, now.time)
            R = body_R_cam.matrix().T @ before_R_body.matrix().T @ body_R_cam.matrix()
            return Predicted(CameraMotion(R, elapsed, body_T_cam, body_T_cam), {})
        world_T_before = self._segment.state.pose().compose(body_T_cam)
        world_T_cam = self._segment.predict(now.time).pose().compose(body_T_cam)
        R = world_T_cam.between(world_T_before).rotation().matrix()
        motion = CameraMotion(R, elapsed, world_T_before, world_T_cam)
        return Predicted(motion, self._segment.predicted_lines(now.time))

    # -- start and end of a segment --------------------------------------------------------------

    def _try_start(self, now: FrameTime) -> bool:
        """Begin a segment if what was seen so far allows it."""
        if self._initializer.is_due(now.time) and self._search_clock(now.time):
            return False
        first = self._initializer.attempt(now, self.clock_search.config)
        if first is None:
            return False
        start, drift = first.start, Drift()
        if self.last_believed is not None:
            start, drift = continued(start, self.last_believed, self.config.integrity)
        self._trial = None
        number, self._segments = self._segments, self._segments + 1
        self._segment = TrajectorySegment(
            number,
            self.calibration,
            self.config,
            self._stages,
            start,
            first.frames,
            drift,
            self.last_believed,
        )
        if not self._segment.confirmed:
            self._trial = Trial(start, now.time, self.config.integrity)
        return True

    def _holds(self, segment: TrajectorySegment, now: FrameTime) -> bool:
        """Whether the segment goes on; a start in motion that was none is taken back."""
        trial, failure = self._trial, segment.failure
        if trial is not None:
            passed = trial.passed(segment.window)
            if trouble := trial.trouble or failure:
                self.warnings.append(
                    f"the start in motion before {now.time:.2f} s is taken back: {trouble}"
                )
                self._take_back(now.time)
                return False
            if passed:
                segment.confirm()
                self._trial = None
        elif failure:
            self.warnings.append(f"{failure} at {now.time:.2f} s: a new segment begins")
            self._end_segment()
            return False
        return True

    def _take_back(self, time: float) -> None:
        """Forget a start that is on trial."""
        self._segment = self._trial = None
        self._segments -= 1
        self._initializer.wait_from(time)

    def _search_clock(self, time: float) -> bool:
        """Time the frames by the offset that the images tell, if that is another one."""
        clock = self._stages.clock
        # Before a start the calibration stands until something speaks against it.
        known = clock.offset._replace(sigma=0.0) if self._segment is None else clock.offset
        found = self.clock_search.search(self._stages.sensors.imu, known)
        if found is None:
            return False
        if self._trial is not None:
            self._take_back(time)
        elif self._segment is not None:
            self._end_segment()
        correction = found.value - self.calibration.time_offset
        self._initializer.retime(correction - self._stages.sensors.correction)
        clock.offset = found
        return True

    def _break(self, gap: Gap) -> None:
        """The IMU was silent: end the segment, begin anew."""
        sensors = self._stages.sensors
        if self._segment is not None:
            self.warnings.append(
                f"no IMU for {(gap.stop - gap.start) * 1e-9:.2f} s from "
                f"{sensors.seconds(gap.start):.2f} s: a new segment begins where the last one ended"
            )
        self._end_segment()
        sensors.begin_anew(gap.stop)

    def _look_for_gap(self, time: float) -> None:
        """Without a frame for so long that nothing of the window is left: end the segment."""
        window = self.window
        if window is None or time - window.newest.time < self.config.window.lag:
            return
        since = self._stages.sensors.frames.last.time
        self.warnings.append(
            f"no frame for {time - since:.2f} s from {since:.2f} s: a new segment begins where the "
            "last one ended"
        )
        self._end_segment()

    def _end_segment(self) -> None:
        self.finish()
        self._stages.sensors.frames.clear()
        self._stages.front_end.clear()
        self.clock_search.begin_anew()


def smooth(
    measurements: Iterable[Measurement],
    calibration: Calibration,
    config: Config | None = None,
) -> Iterator[Estimate]:
    """Live estimates, one for each frame from the start on, of a recording's `stream()`.

    For smoothed estimates and lines use `Odometry`.
    """
    odometry = Odometry(calibration, config)
    for measurement in measurements:
        odometry.add(measurement)
        yield from odometry.take_live()
        odometry.take_smoothed()
        odometry.take_lines()
    odometry.finish()
    yield from odometry.take_live()
