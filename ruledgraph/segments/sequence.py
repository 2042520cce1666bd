# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Trajectory segments: each begins with a start and ends with a failure or a gap."""

import numpy as np

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Status
from ruledgraph.core.measurements import Gap
from ruledgraph.imu.propagation import rotated_half_turn
from ruledgraph.initialization.calibration_search import CalibrationSearch
from ruledgraph.initialization.initializer import Initializer
from ruledgraph.integrity.gauge import GaugeUncertainty, ReliableState, continued
from ruledgraph.segments.segment import TrajectorySegment
from ruledgraph.segments.trial import Trial
from ruledgraph.stages import Stages
from ruledgraph.synchronization.frame_history import FrameTime


class SegmentSequence:
    """Begins, confirms and ends segments."""

    def __init__(self, calibration: Calibration, config: Config, stages: Stages) -> None:
        self.current: TrajectorySegment | None = None
        """None before a start, and between a segment's end and the next start."""
        self.last_status: Status | None = None
        """Of the last frame."""
        self.last_reliable: ReliableState | None = None
        """The last state whose lines fitted, where the next segment begins."""
        warnings = stages.output.warnings
        self.calibration_search = CalibrationSearch(
            stages.online_calibration, stages.clock, config, warnings
        )
        """Searches for the time offset by the rotation seen in the images."""
        self.initializer = Initializer(stages, self.calibration_search, config)
        self._calibration = calibration
        self._config = config
        self._stages = stages
        self._trial: Trial | None = None
        self._count = 0

    @property
    def status(self) -> str:
        """See `Odometry.status`."""
        if sensor := self._stages.synchronizer.waits_for:
            return f"waiting for {sensor}"
        if self.current is None or self.last_status is None:
            return f"initializing: {self.initializer.refusal or 'no attempt to start yet'}"
        on_trial = "initializing: the start is on trial"
        return self.last_status if self.current.confirmed else on_trial

    @property
    def has_start(self) -> bool:
        """Whether there is a segment whose start is accepted."""
        return self.current is not None and self.current.confirmed

    # -- beginning -------------------------------------------------------------------------------

    def try_start(self, now: FrameTime) -> None:
        """Begin a segment if what was seen so far allows it."""
        if self.initializer.is_due(now.time) and self._search_calibration(now.time):
            return
        first = self.initializer.attempt(now)
        if first is None:
            return
        start, gauge_uncertainty = first.start, GaugeUncertainty()
        if self.last_reliable is not None:
            start, gauge_uncertainty = continued(start, self.last_reliable, self._config.integrity)
        self.current = TrajectorySegment(
            self._count, self._config, self._stages, start, gauge_uncertainty
        )
        self.current.begin(first.frames)
        self._count += 1
        self._trial = None
        if not self.current.confirmed:
            self._trial = Trial(start, now.time, self._config)

    def decide(self, segment: TrajectorySegment, now: FrameTime) -> bool:
        """After a new state: accept a start on trial or discard it, end a segment that failed.
        Whether it goes on.
        """
        trial, failure, warnings = self._trial, segment.failure, self._stages.output.warnings
        if trial is not None:
            trial.update(segment.window, segment.monitor.lines_fit)
            if reason := trial.failure or failure:
                which = f"the start in motion before {now.time:.2f} s"
                warnings.append(f"{which} is discarded: {reason}")
                self._discard_start(now.time, reason)
                return False
            if trial.is_passed:
                segment.confirm()
                self._trial = None
        elif failure:
            warnings.append(f"{failure} at {now.time:.2f} s: a new segment begins")
            self.end()
            return False
        return not self._search_calibration(now.time)

    def begin_anew(self) -> None:
        """Forget what was seen, and a start that is on trial."""
        if self.current is None:
            self.initializer.wait_from(-np.inf)
        else:
            self._discard_start(-np.inf, "the rows of its images were read anew")
        self._forget_frames()

    def _discard_start(self, time: float, reason: str) -> None:
        """Forget a start that is on trial, and its time offset; say why until the next attempt."""
        synchronizer, known = self._stages.synchronizer, self._stages.clock.offset.value
        self.initializer.retime(
            known - self._calibration.time_offset - synchronizer.offset_correction
        )
        self.initializer.restart(f"the last start is discarded: {reason}")
        self.current = self._trial = None
        self._count -= 1
        self.initializer.wait_from(time)

    def _search_calibration(self, time: float) -> bool:
        """Begin anew with the offset, or the rotation of the camera, that the images show, if that
        is another one.
        """
        clock, segment = self._stages.clock, self.current
        # Before a start the calibration stands until something speaks against it.
        known = clock.offset._replace(sigma=0.0) if segment is None else clock.offset
        by_window = (
            segment is not None and segment.confirmed and not segment.monitor.is_contradicted
        )
        found = self.calibration_search.search(self._stages.synchronizer.imu, known, by_window)
        if found is None and not self.calibration_search.rotation_replaced:
            return False
        if self._trial is not None:
            self._discard_start(time, "images and gyroscope disagree with its calibration")
        elif segment is not None:
            self.end()
        if found is not None:
            correction = found.value - self._calibration.time_offset
            self.initializer.retime(correction - self._stages.synchronizer.offset_correction)
            clock.offset = found
        return True

    # -- ending ----------------------------------------------------------------------------------

    def end_at(self, gap: Gap) -> None:
        """The IMU was silent: end the segment, begin anew."""
        synchronizer = self._stages.synchronizer
        if self.current is not None:
            self._stages.output.warnings.append(
                f"no IMU for {(gap.stop - gap.start) * 1e-9:.2f} s from "
                f"{synchronizer.seconds(gap.start):.2f} s: "
                "a new segment begins where the last one ended"
            )
        self.end()
        synchronizer.restart(gap.stop)

    def end_if_cut_off(self, time: float) -> None:
        """End a segment that cannot be carried on to a frame at a time, s: nothing of its window is
        left by then, or the body has turned by more than half a turn since the newest state. Warn
        where it goes on after long without frames.
        """
        segment, warnings = self.current, self._stages.output.warnings
        if segment is None:
            return
        since, newest = self._stages.synchronizer.frames.last.time, segment.window.newest.time
        if time - newest >= self._config.window.lag:
            why = f"no frame for {time - since:.2f} s from {since:.2f} s"
        elif rotated_half_turn(self._stages.synchronizer.imu, segment.window.newest, time):
            why = f"more than half a turn between the frames at {since:.2f} and {time:.2f} s"
        elif time - since > self._config.imu.silent_time:
            gap = f"no frame for {time - since:.2f} s from {since:.2f} s: the IMU alone carried on"
            warnings.counted("frames are missing", gap)
            return
        else:
            return
        warnings.append(f"{why}: a new segment begins where the last one ended")
        self.end()

    def end_without_frames(self, kept: float) -> None:
        """End the segment when no frame came for so long, s; keep what a new start needs."""
        synchronizer = self._stages.synchronizer
        # Stamps may be that far behind the IMU by a known offset.
        late = self._config.imu.max_frame_wait + max(-self._calibration.time_offset, 0.0)
        frames, before = synchronizer.frames, synchronizer.imu.latest - kept - late
        if frames and frames.last.time < before:
            self.end_if_cut_off(synchronizer.imu.latest)
            self.end()
        if not frames:
            synchronizer.imu.forget(before)

    def end(self) -> None:
        """End the segment, if there is one, and forget what was seen."""
        reason = "the last segment has ended" if self.current else self.initializer.refusal
        self.finish()
        self._forget_frames()
        self.calibration_search.restart()
        self.initializer.restart(reason)

    def _forget_frames(self) -> None:
        self._stages.synchronizer.frames.clear()
        self._stages.front_end.clear()

    def finish(self) -> None:
        """Hand out what is still in the window."""
        segment, trial = self.current, self._trial
        self.current = self._trial = None
        if segment is None:
            return
        if trial is not None:
            at = f"on trial when its segment ended at {segment.window.newest.time:.2f} s"
            self._stages.output.warnings.append(f"a start was {at}: its frames are degraded")
        segment.finish()
        self.last_reliable = segment.last_reliable or self.last_reliable
