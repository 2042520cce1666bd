# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The odometry: measurements in, estimates out. This file names the stages and their order."""

from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.backend.landmarks import GraphLine
from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.states import Interval
from ruledgraph.backend.time_offset import RETRY, TimeOffset, concern, followed
from ruledgraph.calibration.sensors import Calibration, FloatArray
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Estimate, Output, Status
from ruledgraph.core.measurements import Frame, Gap, ImuSample, Measurement
from ruledgraph.frontend.detection import Detection
from ruledgraph.frontend.gradient import Gradient
from ruledgraph.frontend.line_detection import DETECTORS
from ruledgraph.frontend.prefetch import Foreseen
from ruledgraph.frontend.ruling_prediction import CameraMotion, predict
from ruledgraph.frontend.tracks import Tracker
from ruledgraph.imu.synchronizer import Intake, image_fault
from ruledgraph.initialization.initializer import Refusal, is_still, start_at_rest, start_in_motion
from ruledgraph.integrity.monitor import Trust
from ruledgraph.integrity.segments import Drift, Ended, Trial, continued

# How long rest must last, s, and how often a start is tried.
_REST, _BETWEEN_ATTEMPTS = 0.4, 0.25
# Frames and knots at these intervals (s) are on time when they come this much early.
_EARLY = 0.004
# At rest the window is solved this often (s), while the image has not moved since by more, px.
_IDLE, _UNMOVED = 0.8, 0.2
# Gradients, of eight times the memory of an image, are computed of so many frames ahead at most.
_MOST_GRADIENTS = 32
# New lines are looked for this often at most, s.
_DETECT_INTERVAL = 0.1
# With fewer lines of the graph in view for so long (s), the IMU alone carries the estimate.
_FEWEST_LINES, _LINES_MISSING = 2, 0.3
# Measurements are kept this much longer than the window, s.
_SPARE = 0.5
_RAN_AWAY = "the estimate ran away"


class _Seen(NamedTuple):
    """A frame that was processed."""

    stamp: int
    """ns, also its name."""
    time: float
    """s, on the IMU's clock."""


class Odometry(Output):
    """Visual-inertial odometry from lines.

    Feed it in order of time with `add`, or `add_imu` and `add_image`; a frame is processed when the
    IMU has reached its time. Take out what has come with the `take_` methods; call `finish` at the
    end. Live estimates after a start in motion wait until it is confirmed, some tenths of a second.
    """

    def __init__(self, calibration: Calibration, config: Config | None = None) -> None:
        super().__init__()
        self.calibration = calibration
        self.config = config or Config()
        edges = self.config.edges
        self.tracker = Tracker(calibration.camera, edges)
        self.window: Window | None = None
        self._detection = Detection(self.tracker, DETECTORS[edges.detector])
        self._gradients = Foreseen[Gradient](_MOST_GRADIENTS)
        self._intake = Intake(calibration, self.warnings)
        self._imu = self._intake.imu
        self._frames: deque[_Seen] = deque()
        self._last_attempt = self._last_lines = -np.inf
        # At rest new lines are looked for, and the window is solved, this often, s.
        self._idle = min(self.config.window.lag / 2.0, _IDLE)
        self._state = gtsam.NavState()
        self._status: Status = "tracking"
        self._last_status: Status = "tracking"
        self._ahead: gtsam.PreintegratedCombinedMeasurements | None = None
        self._ahead_until = 0.0
        self._live_by_stamp: dict[int, Estimate] = {}
        self._trust = Trust(calibration.body_T_cam, Drift(), self.warnings)
        self._trial: Trial | None = None
        self._held: list[Estimate] = []
        self._segment = -1
        self._last: Ended | None = None
        self._before: Ended | None = None
        self._retimed = False
        self.refusal = ""
        """Why the last attempt to start was none; empty after a start."""
        self.time_offset = TimeOffset(calibration.time_offset, 0.0)
        """t_imu - t_cam, s, as last known; without deviation when it is not estimated."""
        if self.config.time_offset.estimate:
            self.time_offset = self.time_offset._replace(sigma=self.config.time_offset.sigma)

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
        gap = self._intake.add_imu(sample)
        if gap is not None:
            self._break(gap)
            self._intake.add_imu(sample)
        while (frame := self._intake.next_frame()) is not None:
            with self._timed("frame"):
                self._process(frame)

    def add_image(self, frame: Frame) -> None:
        """A grey image of the calibration's size.

        Raises:
            RuledgraphError: for another image.
        """
        self._intake.add_image(frame)

    def foresee(self, frame: Frame) -> None:
        """Begin with what will be needed of a frame that will be added, to save time then.

        May be called from another thread, for each frame in order. What is wrong with a frame is
        said when it is added.
        """
        if image_fault(frame, self.calibration.camera):
            return
        if not self._gradients.full:
            self._gradients.put(frame, Gradient(frame.image))
        self._detection.foresee(frame)

    def finish(self) -> None:
        """Hand out what is still in the window."""
        if self.window is None:
            return
        left = [frame for frame in self._frames if frame.time > self.window.newest.time]
        if self.window.is_plausible():
            if left:
                self._add_knot(left, self._is_still(left[-1].time))
            if self.window.intervals and self.window.newest.time > self.window.solved:
                self._optimize(self.window)
        for interval in self.window.intervals:
            self._hand_out(self.window, interval)
        self._hand_out_lines([*self.window.retired, *self.window.lines.values()])
        self._end_trial()
        for recovery in self.window.recoveries:
            self.recoveries.append(recovery)
        self.window = None

    @property
    def status(self) -> Status:
        """Of the last frame."""
        return self._last_status

    # -- one frame -------------------------------------------------------------------------------

    def _process(self, frame: Frame) -> None:
        seen = _Seen(frame.stamp, self._intake.frame_time(frame))
        if not self._imu.covers(seen.time, seen.time):
            return  # before the first IMU sample
        last = self._frames[-1] if self._frames else None
        # By stamps, too: the time of one and the same changes with the correction.
        if last is not None and (seen.stamp <= last.stamp or seen.time <= last.time):
            if seen.stamp < last.stamp:
                self.warnings.once(
                    "late",
                    f"a frame at {seen.time:.2f} s came after a later one: such are not used",
                )
            return
        if self._detection.pending:
            with self._timed("detection"):
                self._detection.start_tracks()
        self._look_for_gap(seen.time)
        with self._timed("gradient"):
            gradient = self._gradients.take(frame) or Gradient(frame.image)
        due = self._is_knot_due(seen.time)
        if self._is_detection_due(seen.time, due):
            self._detection.begin(frame, gradient, seen.time)
        with self._timed("search"):
            lines = self._follow(seen, gradient)
        self._frames.append(seen)
        at_knot = False
        if self.window is None:
            with self._timed("start"):
                at_knot = self._try_start(seen)
        elif due:
            with self._timed("smoother"):
                newest = self.window.newest.time
                self._advance(self.window, [f for f in self._frames if f.time > newest])
            at_knot = True
            if self._trial is not None and not self._passes(self._trial, self.window, seen.time):
                return
            if self._trust.lost or not self.window.is_plausible():
                why = "most lines do not fit the estimate" if self._trust.lost else _RAN_AWAY
                self.warnings.append(f"{why} at {seen.time:.2f} s: a new segment begins")
                self._end_segment()
                return
        if self.window is not None:
            self._report(self.window, seen, lines, at_knot)
        self.tracker.drop_lost()
        self._forget(seen.time)

    def _follow(self, seen: _Seen, gradient: Gradient) -> int:
        """Search every track where it is predicted; returns how many of the graph were found."""
        if not self._frames:
            return 0
        before = self._frames[-1]
        world_T_before = self._state.pose().compose(self.calibration.body_T_cam)
        world_T_cam = world_T_before
        if self.window is None:
            cam_R_before = self._turn(before.time, seen.time)
        else:
            self._predict(self.window, seen.time)
            world_T_cam = self._state.pose().compose(self.calibration.body_T_cam)
            cam_R_before = world_T_cam.between(world_T_before).rotation().matrix()
        motion = CameraMotion(cam_R_before, seen.time - before.time, world_T_before, world_T_cam)
        known = self.window.lines if self.window is not None else {}
        is_blind = self.window is not None and self._is_blind(self.window, seen.time)
        placed = {} if is_blind else known
        focal = self.calibration.camera.focal_length
        rulings = predict(self.tracker.tracks, placed, motion, focal)
        found = self.tracker.follow(seen.stamp, seen.time, gradient, rulings)
        return sum(track.number in known for track in found)

    def _is_knot_due(self, time: float) -> bool:
        if self.window is None:
            return False
        return time - self.window.newest.time >= self.config.window.knot_interval - _EARLY

    def _is_detection_due(self, time: float, at_knot: bool) -> bool:
        tracking = self.window is not None
        every = self._idle if tracking and self._status == "still" else _DETECT_INTERVAL
        # At a knot it costs little time: the smoother works meanwhile.
        return self._detection.is_due(time, every - _EARLY) and (at_knot or not tracking)

    def _is_blind(self, window: Window, time: float) -> bool:
        """Whether the IMU's prediction crosses a doubt that no line has bridged yet."""
        guessed = bool(window.intervals) and not window.intervals[-1].is_known
        return guessed or bool(self._imu.doubts(window.newest.time, time))

    def _turn(self, start: float, stop: float) -> FloatArray:
        """cam_R_before between two frames, from the gyroscope alone."""
        turn = gtsam.Rot3()
        for segment in self._imu.between(start, stop).segments(start, stop):
            turn = turn.compose(gtsam.Rot3.Expmap(segment.gyroscope * segment.dt))
        body_R_cam = self.calibration.body_T_cam.rotation().matrix()
        return np.asarray(body_R_cam.T @ turn.matrix().T @ body_R_cam)

    def _predict(self, window: Window, time: float) -> None:
        """The state at a frame after the newest knot, by the IMU."""
        knot = window.newest
        if self._ahead is None:
            params = self.calibration.imu_noise.preintegration_params()
            self._ahead = gtsam.PreintegratedCombinedMeasurements(params, knot.bias)
            self._ahead_until = knot.time
        samples = self._imu.between(self._ahead_until, time)
        for segment in samples.segments(self._ahead_until, time, bias=knot.bias):
            self._ahead.integrateMeasurement(*segment)
        self._ahead_until = time
        self._state = self._ahead.predict(knot.state, knot.bias)

    # -- start and end of a segment --------------------------------------------------------------

    def _try_start(self, seen: _Seen) -> bool:
        """Begin a window if what was seen so far allows it."""
        if seen.time - self._last_attempt < _BETWEEN_ATTEMPTS:
            return False
        length = self.config.start.window
        if self._is_still(seen.time):
            used = [seen]
            result = start_at_rest(self._imu, seen.stamp, seen.time - _REST, seen.time, self.config)
        elif self._imu.doubts(seen.time - length, seen.time):
            return False
        elif seen.time - self._frames[0].time >= length - _EARLY:
            used = [f for f in self._frames if f.time >= seen.time - length - _EARLY]
            stamps, times = [f.stamp for f in used], [f.time for f in used]
            result = start_in_motion(
                self._imu, stamps, times, self.tracker.tracks, self.calibration, self.config
            )
        else:
            return False
        self._last_attempt = seen.time
        if isinstance(result, Refusal):
            self._retimed = False
            self.refusal = result.reason
            self.warnings.append(f"no start at {seen.time:.2f} s: {result.reason}")
            return False
        again, self._retimed = self._retimed, False
        if result.time_offset is not None and abs(result.time_offset.value) > RETRY and not again:
            self._retime(result.time_offset.value)
            return False
        self.refusal = ""
        drift = Drift()
        if self._last is not None:
            result, drift = continued(result, self._last)
        self.window = Window(self.calibration, self.config, result, self._intake.correction)
        self._trust = Trust(self.calibration.body_T_cam, drift, self.warnings)
        self._trial = Trial(result, seen.time) if result.lines else None
        self._before = self._last
        self._segment += 1
        self._last_lines = seen.time
        self._state = self.window.newest.state
        pending: list[_Seen] = []
        for frame in used[1:]:
            pending.append(frame)
            elapsed = frame.time - self.window.newest.time
            if elapsed >= self.config.window.knot_interval - _EARLY or frame is seen:
                self._add_knot(pending, self._is_still(frame.time))
                pending = []
        if len(used) > 1:
            self._optimize(self.window)
        return True

    def _retime(self, change: float) -> None:
        """Move all frames in time before a start that is tried again with the next one."""
        self._retimed, self._last_attempt = True, -np.inf
        self._intake.correction += change
        latest = self._imu.latest
        moved = (frame._replace(time=frame.time + change) for frame in self._frames)
        self._frames = deque(f for f in moved if self._imu.covers(f.time, latest))
        for track in self.tracker.tracks:
            track.born, track.last_seen = track.born + change, track.last_seen + change
        self._detection.move(change)

    def _passes(self, trial: Trial, window: Window, time: float) -> bool:
        """Go on with a start in motion, or take it back."""
        passed = trial.passed(window)
        if trial.trouble or self._trust.lost or not window.is_plausible():
            trouble = trial.trouble or ("its lines do not fit" if self._trust.lost else _RAN_AWAY)
            self.warnings.append(
                f"the start in motion before {time:.2f} s is taken back: {trouble}"
            )
            self._held, self._trial, self.window, self._ahead = [], None, None, None
            self._live_by_stamp.clear()
            self._last = self._before
            self._segment -= 1
            self._last_attempt = time
            return False
        if passed:
            self._end_trial()
        return True

    def _end_trial(self) -> None:
        self._live += self._held
        self._held, self._trial = [], None

    def _break(self, gap: Gap) -> None:
        """The IMU was silent: end the segment, begin anew."""
        if self.window is not None:
            self.warnings.append(
                f"no IMU for {(gap.stop - gap.start) * 1e-9:.2f} s from "
                f"{self._intake.seconds(gap.start):.2f} s: a new segment begins where the last one "
                "ended"
            )
        self._end_segment()
        self._intake.begin_anew(gap.stop)

    def _look_for_gap(self, time: float) -> None:
        """Without a frame for so long that nothing of the window is left: end the segment."""
        if self.window is None or time - self.window.newest.time < self.config.window.lag:
            return
        since = self._frames[-1].time
        self.warnings.append(
            f"no frame for {time - since:.2f} s from {since:.2f} s: a new segment begins where the "
            "last one ended"
        )
        self._end_segment()

    def _end_segment(self) -> None:
        self.finish()
        self._frames.clear()
        self.tracker.tracks.clear()
        self._detection.forget()
        self._ahead = None

    def _is_still(self, time: float) -> bool:
        """Whether body and image have rested until now, for some time and since the last knot."""
        begin = time - _REST
        if self.window is not None:
            # Since the rest began, as far as it is known: slow motion shows only then.
            begin = min(begin, max(self.window.rests_since, self._frames[0].time))
        if not self._imu.covers(begin, time):
            return False
        return is_still(self._imu, begin, time, lambda: self._image_motion(begin))

    def _image_motion(self, since: float) -> float:
        """How far the image moved since a time, px; inf where that is not known."""
        before = [f for f in self._frames if f.time <= since + _EARLY]
        return self.tracker.image_motion(before[-1].stamp) if before else np.inf

    # -- knots -----------------------------------------------------------------------------------

    def _advance(self, window: Window, frames: list[_Seen]) -> None:
        """The next knot, at the last of the frames that follow the newest one."""
        time = frames[-1].time
        still = self._is_still(time)
        idle = still and self._trial is None and time - window.solved < self._idle - _EARLY
        if idle and self._image_motion(window.solved) < _UNMOVED:
            self._add_knot(frames, still, look=False)
            self._ahead, self._state = None, window.newest.state
        else:
            self._add_knot(frames, still)
            self._optimize(window)

    def _add_knot(self, frames: list[_Seen], still: bool, look: bool = True) -> None:
        assert self.window is not None  # noqa: S101 - a knot needs its window
        self._status = "still" if still else "tracking"
        stamps, times = [f.stamp for f in frames], [f.time for f in frames]
        tracks = self.tracker.tracks if look else []
        self.window.extend(stamps, times, self._imu, tracks, still, self._intake.correction)

    def _optimize(self, window: Window) -> None:
        for interval in window.optimize():
            self._hand_out(window, interval)
        self._hand_out_lines(window.retired)
        window.retired = []
        self._trust.judge(window, self._status == "still")
        self._ahead = None
        self._state = window.newest.state
        if window.time_offset is not None:
            self._follow_clock(window.time_offset)

    def _follow_clock(self, offset: TimeOffset) -> None:
        """Time the frames to come by what is known of the offset, once a start has held."""
        calibrated = self.calibration.time_offset
        self.time_offset = offset.moved(calibrated)
        if self._trial is not None or self._trust.disagree:
            return
        if message := concern(self._intake.correction, offset, calibrated):
            self.warnings.once("time offset", message)
        self._intake.correction = followed(self._intake.correction, offset)

    def _report(self, window: Window, seen: _Seen, lines: int, at_knot: bool) -> None:
        if lines >= _FEWEST_LINES:
            self._last_lines = seen.time
        status = self._status
        unsure = self._imu.is_unsure(seen.time)
        if unsure or self._trust.disagree or self._is_blind(window, seen.time):
            status = "doubtful"
        elif status == "tracking":
            missing = seen.time - self._last_lines > _LINES_MISSING
            status = "dead reckoning" if missing or self._trust.parallel else status
        self._last_status = status
        knot, pose, velocity = window.newest, self._state.pose(), self._state.velocity()
        covariances = self._trust.covariances(knot.covariances, pose, velocity)
        estimate = Estimate(
            stamp=seen.stamp,
            world_T_body=pose,
            velocity=velocity,
            bias=knot.bias,
            covariances=covariances,
            lines=lines,
            status=status,
            at_knot=at_knot,
            segment=self._segment,
            time_offset=self.time_offset,
        )
        if not self._trust.misfits:  # else it may be lost since then
            self._last = Ended(seen.time, pose, velocity, covariances)
        (self._live if self._trial is None else self._held).append(estimate)
        self._live_by_stamp[seen.stamp] = estimate

    def _hand_out(self, window: Window, interval: Interval) -> None:
        """The smoothed estimates of an interval's frames, and of the window's first frame."""
        knot = interval.knot
        otherwise: Status = "doubtful" if self._trust.disagree else "tracking"
        stamps, poses = interval.stamps[interval.again :], interval.poses()[interval.again :]
        if knot.index == 0:
            stamps, poses = [window.first_stamp, *stamps], [knot.state.pose(), *poses]
        for stamp, pose in zip(stamps, poses, strict=True):
            live, velocity = self._live_by_stamp.pop(stamp, None), knot.state.velocity()
            covariances = (
                live.covariances
                if live
                else self._trust.covariances(knot.covariances, pose, velocity)
            )
            self._smoothed.append(
                Estimate(
                    stamp=stamp,
                    world_T_body=pose,
                    velocity=velocity,
                    bias=knot.bias,
                    covariances=covariances,
                    lines=live.lines if live else 0,
                    status=live.status if live else otherwise,
                    at_knot=stamp == interval.stamps[-1],
                    segment=self._segment,
                    time_offset=live.time_offset if live else self.time_offset,
                )
            )

    def _hand_out_lines(self, lines: Iterable[GraphLine]) -> None:
        estimates = (line.estimate() for line in lines)
        self._lines += [estimate for estimate in estimates if estimate is not None]

    # -- bookkeeping -----------------------------------------------------------------------------

    def _forget(self, time: float) -> None:
        keep = max(self.config.start.window, self.config.window.lag) + _SPARE
        while self._frames[0].time < time - keep:
            self._frames.popleft()
        oldest = self._frames[0].stamp
        for track in self.tracker.tracks:
            while track.sightings and track.sightings[0].stamp < oldest:
                track.sightings.popleft()
        self._imu.forget(time - keep)


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
