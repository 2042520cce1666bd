# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Estimates as they are handed out: live, held back while a start is on trial, and smoothed."""

from collections.abc import Iterable, Sequence

import gtsam

from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.states import Interval
from ruledgraph.core.config import LinesConfig
from ruledgraph.core.estimates import Estimate, Status
from ruledgraph.core.output import Output
from ruledgraph.core.time_offset import TimeOffset
from ruledgraph.imu.frame_history import FrameTime
from ruledgraph.integrity.monitor import IntegrityMonitor


class EstimateReporter:
    """Makes the estimates of one trajectory segment.

    Args:
        output: where they go.
        segment: its number.
        monitor: of its integrity.
        lines: says how far lines reach.
        hold: keep live estimates back until `release`.
    """

    def __init__(
        self,
        output: Output,
        segment: int,
        monitor: IntegrityMonitor,
        lines: LinesConfig,
        hold: bool,
    ) -> None:
        self._output = output
        self._segment = segment
        self._monitor = monitor
        self._extent_outliers = lines.extent_outliers
        self._live_by_stamp: dict[int, Estimate] = {}
        self._held: list[Estimate] | None = [] if hold else None

    def release(self) -> None:
        """Hand out the live estimates that were held back, and those to come at once."""
        self._output.put(live=self._held or ())
        self._held = None

    def live(
        self,
        window: Window,
        frame: FrameTime,
        state: gtsam.NavState,
        status: Status,
        lines: int,
        at_knot: bool,
        time_offset: TimeOffset,
    ) -> Estimate:
        """The estimate of the latest frame."""
        knot, pose, velocity = window.newest, state.pose(), state.velocity()
        estimate = Estimate(
            stamp=frame.stamp,
            world_T_body=pose,
            velocity=velocity,
            bias=knot.bias,
            covariances=self._monitor.covariances(knot.covariances, pose, velocity),
            lines=lines,
            status=status,
            at_knot=at_knot,
            segment=self._segment,
            time_offset=time_offset,
        )
        if self._held is None:
            self._output.put(live=[estimate])
        else:
            self._held.append(estimate)
        self._live_by_stamp[frame.stamp] = estimate
        return estimate

    def smoothed(
        self, window: Window, intervals: Sequence[Interval], time_offset: TimeOffset
    ) -> None:
        """The estimates of intervals' frames, and of the window's first frame."""
        for interval in intervals:
            self._output.put(smoothed=self._of_interval(window, interval, time_offset))

    def _of_interval(
        self, window: Window, interval: Interval, time_offset: TimeOffset
    ) -> Iterable[Estimate]:
        knot = interval.knot
        otherwise: Status = "doubtful" if self._monitor.disagree else "tracking"
        stamps, poses = interval.stamps[interval.again :], interval.poses()[interval.again :]
        if knot.index == 0:
            stamps, poses = [window.first_stamp, *stamps], [knot.state.pose(), *poses]
        for stamp, pose in zip(stamps, poses, strict=True):
            live, velocity = self._live_by_stamp.pop(stamp, None), knot.state.velocity()
            covariances = (
                live.covariances
                if live
                else self._monitor.covariances(knot.covariances, pose, velocity)
            )
            yield Estimate(
                stamp=stamp,
                world_T_body=pose,
                velocity=velocity,
                bias=knot.bias,
                covariances=covariances,
                lines=live.lines if live else 0,
                status=live.status if live else otherwise,
                at_knot=stamp == interval.stamps[-1],
                segment=self._segment,
                time_offset=live.time_offset if live else time_offset,
            )

    def lines(self, landmarks: Iterable[Landmark]) -> None:
        """Lines that left the window."""
        estimates = (landmark.estimate(self._extent_outliers) for landmark in landmarks)
        self._output.put(lines=[estimate for estimate in estimates if estimate is not None])
