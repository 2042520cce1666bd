# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The odometry: measurements in, estimates out. This file names the stages and their order."""

from collections import deque
from dataclasses import replace

from ruledgraph.backend.sliding_window import Window
from ruledgraph.calibration.online_calibration import OnlineCalibration
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.config import Config
from ruledgraph.core.measurements import Frame, ImuSample, Measurement
from ruledgraph.core.output import Output
from ruledgraph.frontend.tracker import Tracker
from ruledgraph.initialization.calibration_search import CalibrationSearch
from ruledgraph.integrity.gauge import ReliableState
from ruledgraph.segments.frame_prediction import frame_prediction
from ruledgraph.segments.rows import row_motion
from ruledgraph.segments.segment import TrajectorySegment
from ruledgraph.segments.sequence import SegmentSequence
from ruledgraph.stages import Stages
from ruledgraph.synchronization.frame_history import TIME_TOLERANCE, FrameTime
from ruledgraph.synchronization.image_input import image_fault

# Measurements are kept this much longer than the window and the longest time without a solution,
# s: more than a late frame needs.
_SPARE = 0.5
# s; the points of a rolling shutter are turned by the gyroscope of their rows' times. A smaller
# change has little effect: hands turn a camera by 10 rad/s^2, over 10 ms of rows that is 0.2 px.
_MAX_TIMING_CHANGE = 5e-3


class Odometry(Output):
    """Visual-inertial odometry from lines.

    Feed it in order of time with `add`, or `add_imu` and `add_image`; a frame is processed when the
    IMU has reached its time. Take out what has come with the `take_` methods; call `finish` at the
    end. Live estimates after a start in motion wait until it is confirmed, some tenths of a second.
    """

    def __init__(self, calibration: Calibration, config: Config | None = None) -> None:
        super().__init__()
        self.calibration = calibration
        self.config = config = (config or Config()).for_time_offset(calibration.time_offset_exact)
        least = config.imu.min_accelerometer_noise, config.imu.min_gyroscope_noise
        calibration = replace(calibration, imu_noise=calibration.imu_noise.at_least(*least))
        self._stages = Stages.build(calibration, config, self)
        self._segments = SegmentSequence(calibration, config, self._stages)
        unsolved = config.rest.solve_interval + config.rest.max_undecided_time
        self._kept = config.window.lag + unsolved + _SPARE
        self._kept_frames: deque[Frame] = deque()

    @property
    def status(self) -> str:
        """`waiting for IMU` or `waiting for images`, whichever of them stopped, by the stamps of
        the other; `initializing:` and why it did not start yet; then the last frame's `Status`.
        """
        return self._segments.status

    @property
    def tracker(self) -> Tracker:
        """The lines in the image."""
        return self._stages.front_end.tracker

    @property
    def window(self) -> Window | None:
        """The lines and states of the graph; None before a start."""
        segment = self._segments.current
        return None if segment is None else segment.window

    @property
    def last_reliable(self) -> ReliableState | None:
        """The last state whose lines fitted, where the next segment begins."""
        return self._segments.last_reliable

    @property
    def calibration_search(self) -> CalibrationSearch:
        """Searches for the time offset by the rotation seen in the images."""
        return self._segments.calibration_search

    @property
    def time_offset(self) -> TimeOffset:
        """t_imu - t_cam, s, as last known; sigma 0 when it is not estimated."""
        return self._stages.clock.offset

    @property
    def online_calibration(self) -> OnlineCalibration:
        """The camera's pose in the body, its readout and its focal length, as last known."""
        return self._stages.online_calibration

    def add(self, measurement: Measurement) -> None:
        """A frame, an IMU sample, or a gap, which ends a segment."""
        if isinstance(measurement, Frame):
            self.add_image(measurement)
        elif isinstance(measurement, ImuSample):
            self.add_imu(measurement)
        else:
            self._segments.end_at(measurement)

    def add_imu(self, sample: ImuSample) -> None:
        """An IMU sample; the frames up to its time are processed.

        Raises:
            RuledgraphError: for another shape, and stamps that are not in nanoseconds.
        """
        synchronizer = self._stages.synchronizer
        gap = synchronizer.add_imu(sample)
        if gap is not None:
            self._segments.end_at(gap)
            synchronizer.add_after_gap(sample)
        self._process_reached()
        self._segments.end_without_frames(self._kept)

    def add_image(self, frame: Frame) -> None:
        """An image; it waits until the IMU has reached its time, but not for ever.

        Raises:
            RuledgraphError: for one that is not grey, of 8 bit and of the calibration's size, and
                for stamps that are not in nanoseconds.
        """
        self._stages.synchronizer.add_image(frame)
        self._process_reached()

    def prefetch(self, frame: Frame) -> None:
        """Begin with what will be needed of a frame that will be added, to save time then.

        May be called from another thread, for each frame in order. What is wrong with a frame is
        said when it is added.
        """
        if not image_fault(frame, self.calibration.camera):
            self._stages.front_end.prefetch(frame)

    def finish(self) -> None:
        """Hand out what is still in the window."""
        self._segments.finish()

    def _process_reached(self) -> None:
        """The frames that the IMU has reached."""
        while (frame := self._stages.synchronizer.next_frame()) is not None:
            with self.timings.measured("frame"):
                self._process(frame)

    def _process(self, frame: Frame) -> None:
        self._keep(frame)
        synchronizer, online_calibration = (
            self._stages.synchronizer,
            self._stages.online_calibration,
        )
        readout, correction = online_calibration.current.readout, synchronizer.offset_correction
        self._estimate(frame)
        synchronizer.calibration = online_calibration.current  # how rows are read may be known now
        self._stages.front_end.set_camera(online_calibration.camera)
        moved = abs(online_calibration.current.readout - readout)
        if online_calibration.current.readout:
            moved = max(moved, abs(synchronizer.offset_correction - correction))
        if moved > _MAX_TIMING_CHANGE and not self._segments.has_start:
            self._repeat()

    def _keep(self, frame: Frame) -> None:
        """The frames of the next start, if their rows may have to be read anew."""
        is_global = not (
            self.online_calibration.current.readout or self.calibration_search.readout.finder
        )
        if self._segments.has_start or is_global:
            self._kept_frames.clear()
            return
        self._kept_frames.append(frame)
        oldest = frame.stamp - round(1e9 * self._kept)
        while self._kept_frames[0].stamp < oldest:
            self._kept_frames.popleft()

    def _repeat(self) -> None:
        """Process the frames before a start anew: their rows were not read as it was thought."""
        known = self._stages.synchronizer.frames
        frames = [f for f in self._kept_frames if known and f.stamp >= known.first.stamp]
        self._kept_frames.clear()
        self._segments.begin_anew()
        for frame in frames:
            self._process(frame)

    def _estimate(self, frame: Frame) -> None:
        synchronizer, segments = self._stages.synchronizer, self._segments
        now = synchronizer.timed(frame)
        if now is None:
            return
        self._stages.front_end.start_tracks()
        segments.end_if_cut_off(now.time)
        segment = segments.current
        due = segment is not None and segment.is_state_due(now.time)
        found = self._searched(frame, now, due)
        synchronizer.frames.append(now)
        if segment is None or segments.last_status != "still":
            with self.timings.measured("clock"):
                self.calibration_search.add_image(synchronizer.seconds(frame.stamp), frame.image)
        if segment is None:
            with self.timings.measured("start"):
                segments.try_start(now)
        elif not self._carried_on(segment, now, due):
            return
        if segments.current is not None:
            segments.last_status = segments.current.report(now, found)
        self._stages.forget(now.time - self._kept)

    def _searched(self, frame: Frame, now: FrameTime, at_state: bool) -> list[int]:
        """Look for the lines where they are predicted; the ids of those that were found."""
        stages, segment = self._stages, self._segments.current
        detect_every: float | None = self.config.tracks.detection_interval - TIME_TOLERANCE
        if segment is not None:
            # At a state it costs little time: the smoother works meanwhile.
            detect_every = segment.detection_interval - TIME_TOLERANCE if at_state else None
        expected, rows = frame_prediction(stages, segment, now), row_motion(stages, segment, now)
        return stages.front_end.process(frame, now.time, expected, detect_every, rows)

    def _carried_on(self, segment: TrajectorySegment, now: FrameTime, due: bool) -> bool:
        """Give the segment a state at a frame, if one is due; whether it goes on."""
        if due or segment.rest_phase.of_state:
            segment.update_rest(now.time)
        if not due:
            return True
        with self.timings.measured("smoother"):
            is_added = segment.advance()
        return not is_added or self._segments.decide(segment, now)
