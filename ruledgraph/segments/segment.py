# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A trajectory segment: from a start until the end of the recording, a gap or a failure."""

from collections.abc import Collection, Sequence

import gtsam
import numpy as np

from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.start import Start
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Status, blocks
from ruledgraph.imu.propagation import ImuPropagator, rotation_bound
from ruledgraph.integrity.gauge import GaugeUncertainty, ReliableState
from ruledgraph.integrity.monitor import IntegrityMonitor
from ruledgraph.segments.reporter import EstimateReporter
from ruledgraph.segments.rest_phase import RestPhase
from ruledgraph.stages import Stages
from ruledgraph.synchronization.frame_history import TIME_TOLERANCE, FrameTime

# rad; a frame gets a state when the body has turned by so much: half of what could be integrated.
_MAX_TURN = 0.5 * np.pi


class TrajectorySegment:
    """A sliding window with its integrity monitor, carried on frame by frame.

    Args:
        number: counts from 0.
        config: all settings.
        stages: before and after it.
        start: where it begins; call `begin` with its frames.
        gauge_uncertainty: of its position and yaw at the start.
    """

    def __init__(
        self,
        number: int,
        config: Config,
        stages: Stages,
        start: Start,
        gauge_uncertainty: GaugeUncertainty,
    ) -> None:
        self._config = config
        self._stages = stages
        self.confirmed = not start.lines
        """Whether the start is accepted; one in motion is on trial first."""
        correction, known = stages.synchronizer.offset_correction, stages.online_calibration
        calibration = known.current
        camera = known.extrinsics, known.focal_ratio
        self.window = Window(calibration, config, start, correction, *camera)
        warnings, on_trial = stages.output.warnings, not self.confirmed
        self.monitor = IntegrityMonitor(gauge_uncertainty, warnings, config, on_trial)
        imu, noise = stages.synchronizer.imu, calibration.imu_noise
        self._reporter = EstimateReporter(
            stages.output,
            number,
            self.monitor,
            imu,
            calibration.middle_row_delay,
            config.lines,
            hold=on_trial,
        )
        self._propagator = ImuPropagator(imu, noise)
        self.state = self.window.newest.state
        """Of the latest frame."""
        self.last_reliable: ReliableState | None = None
        """Its last state whose lines fitted."""
        focal = calibration.camera.focal_length
        self.rest_phase = RestPhase(stages.rest_detector, focal, config, rests=self.confirmed)
        self._last_lines = self.window.newest.time

    def begin(self, frames: Sequence[FrameTime]) -> None:
        """Give states to the frames that the start was made of, its own first, and solve."""
        self._last_lines = frames[-1].time
        pending: list[FrameTime] = []
        for frame in frames[1:]:
            pending.append(frame)
            if self.is_state_due(frame.time) or frame is frames[-1]:
                self.predict(frame.time)
                self.update_rest(frame.time)
                self._extend(pending)
                pending = []
        if len(frames) > 1:
            self._optimize()

    def is_state_due(self, time: float) -> bool:
        """Whether a frame at a time (s) gets a state."""
        elapsed = time - self.window.newest.time
        is_late = elapsed >= self._config.window.state_interval - TIME_TOLERANCE
        rotated = rotation_bound(self._stages.synchronizer.imu, self.window.newest, time)
        return is_late or rotated > _MAX_TURN

    @property
    def detection_interval(self) -> float:
        """How often new lines are looked for, s."""
        tracks = self._config.tracks
        return self.rest_phase.interval if self.rest_phase.of_state else tracks.detection_interval

    def predict(self, time: float) -> gtsam.NavState:
        """Carry the state on to a time (s) after the newest node, by the IMU."""
        self.state = self._propagator.predict(self.window.newest, time)
        return self.state

    @property
    def body_T_cam(self) -> gtsam.Pose3:
        """The camera's pose in the body as the window has it."""
        extrinsics = self.window.self_calibration.extrinsics
        return (extrinsics or self._stages.online_calibration.current).body_T_cam

    def is_motion_unreliable(self, time: float) -> bool:
        """Whether the IMU was unreliable in the last interval or since, up to a time, s."""
        intervals, imu = self.window.intervals, self._stages.synchronizer.imu
        unreliable = bool(intervals) and not intervals[-1].is_reliable
        return unreliable or bool(imu.unreliable(self.window.newest.time, time))

    def advance(self) -> bool:
        """Add a state at the last of the frames that follow the newest one, and solve; False, and
        nothing done, while it is open whether a rest goes on.
        """
        rest, window = self.rest_phase, self.window
        frames = self._stages.synchronizer.frames.after(window.newest.time)
        if rest.is_undecided:
            return False
        idle = rest.goes_on and self.confirmed and rest.is_idle(window, frames[-1].time, self.state)
        self._extend(frames, observe_lines=not idle)
        if idle and not self.window.jumped:
            self.state = self.window.newest.state
        else:
            self._optimize()
        return True

    def update_rest(self, time: float, last: bool = False) -> None:
        """Whether the body rests at a frame, or at the last one, at a time, s."""
        self.rest_phase.update(self.window, time, self.state, self.body_T_cam, last)

    def _extend(self, frames: Sequence[FrameTime], observe_lines: bool = True) -> None:
        still = self.rest_phase.begin_state()
        synchronizer, front_end = self._stages.synchronizer, self._stages.front_end
        tracks = front_end.observed() if observe_lines else []
        correction, limit = synchronizer.offset_correction, self.monitor.jump_threshold
        self.window.extend(frames, synchronizer.imu, tracks, still, correction, limit)
        front_end.reject(self.window.line_manager.take_rejected())
        self._propagator.reset()

    def _optimize(self) -> None:
        window, clock = self.window, self._stages.clock
        self._reporter.report_smoothed(window, window.optimize(), clock.offset)
        self._reporter.lines(window.line_manager.take_retired())
        self._stages.front_end.reject(window.line_manager.take_rejected())
        self.monitor.update(window, self.rest_phase.of_state, self.rest_phase.stayed_at)
        self._propagator.reset()
        self.state = window.newest.state
        reliable = self.confirmed and not self.monitor.is_contradicted
        offset, extrinsics, focal_ratio = window.self_calibration
        clock.update(offset, reliable)
        if reliable:
            self._stages.online_calibration.update(extrinsics, focal_ratio)

    def confirm(self) -> None:
        """Accept a start that was on trial, with covariances as of now, not of the start."""
        self.confirmed = True
        self.monitor.confirm(self.window.newest.time)
        self.window.read_smoothed_covariances()
        self._reporter.release(self.window, accepted=True)

    @property
    def failure(self) -> str:
        """Why it cannot go on; empty while it can."""
        if self.monitor.lost:
            return "most lines do not fit the estimate"
        return "" if self.window.is_plausible() else "the estimate diverged"

    def report(self, frame: FrameTime, found: Collection[int]) -> Status:
        """Hand out the live estimate of a frame in which the tracks with these ids were found."""
        lines = sum(id_ in self.window.lines for id_ in found)
        window, offset = self.window, self._stages.clock.offset
        of_window = blocks(self._propagator.covariance(window.newest, frame.time))
        by_imu = self.monitor.covariances(of_window, self.state.pose(), self.state.velocity())
        self.state, covariances = self.rest_phase.estimate(window, self.state, by_imu)
        pose, velocity = self.state.pose(), self.state.velocity()
        status = self._status(frame.time, lines)
        estimate = self._reporter.report_live(
            window, frame, self.state, covariances, status, lines, offset
        )
        if self.confirmed and not self.monitor.lines_misfit:  # else it may be lost since then
            self.last_reliable = ReliableState(frame.time, pose, velocity, estimate.covariances)
        return estimate.status

    def _status(self, time: float, lines: int) -> Status:
        """But for what the covariances say, see `IntegrityMonitor.rated`."""
        limits = self._config.integrity
        if lines >= limits.min_lines:
            self._last_lines = time
        degraded = self._stages.synchronizer.imu.was_degraded(time)
        if degraded or self.monitor.is_contradicted or self.is_motion_unreliable(time):
            return "degraded"
        if self.rest_phase.is_held:
            return "still"
        if time - self._last_lines > limits.lines_missing_time or self.monitor.parallel:
            return "dead reckoning"
        return "tracking"

    def finish(self) -> None:
        """Hand out what is still in the window; degraded, if the start is on trial or the segment
        ends by a failure.
        """
        window, has_failed = self.window, bool(self.failure)
        left = self._stages.synchronizer.frames.after(window.newest.time)
        if window.is_plausible():
            if left:
                self.update_rest(left[-1].time, last=True)
                self._extend(left)
            if window.intervals and window.newest.time > window.solved:
                self._optimize()
            window.read_smoothed_covariances()
        left_over = list(window.intervals)
        self._reporter.report_smoothed(window, left_over, self._stages.clock.offset, has_failed)
        self._reporter.lines([*window.line_manager.take_retired(), *window.lines.values()])
        self._reporter.release(window, self.confirmed)
        self._stages.output.recoveries.extend(window.recoveries)
