# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Estimates as they are handed out: live, held back while a start is on trial, and smoothed."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import gtsam
import numpy as np

from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.states import Interval
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.calibration_estimates import TimeOffset
from ruledgraph.core.config import LinesConfig
from ruledgraph.core.estimates import Covariances, Estimate, Status, blocks
from ruledgraph.core.output import Output
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.imu.propagation import propagated_covariances, state_before
from ruledgraph.integrity.monitor import IntegrityMonitor
from ruledgraph.synchronization.frame_history import FrameTime


class _FrameState(NamedTuple):
    stamp: int
    pose: gtsam.Pose3
    velocity: FloatArray
    covariance: FloatArray


class EstimateReporter:
    """Makes the estimates of one trajectory segment.

    Args:
        output: where they go.
        segment: its number.
        monitor: of its integrity.
        imu: samples that cover the window.
        middle_row_delay: how much later than its stamp a frame's time is, s.
            Estimates are of the stamp.
        lines: settings of their ends.
        hold: keep everything back until `release`.
    """

    def __init__(
        self,
        output: Output,
        segment: int,
        monitor: IntegrityMonitor,
        imu: ImuBuffer,
        middle_row_delay: float,
        lines: LinesConfig,
        hold: bool,
    ) -> None:
        self._output = output
        self._segment = segment
        self._monitor = monitor
        self._imu = imu
        self._middle_row_delay = middle_row_delay
        self._extent_outliers = lines.extent_outliers
        self._live_by_stamp: dict[int, Estimate] = {}
        """Not rated yet; neither are live estimates that are held back."""
        self._held = Output() if hold else None

    def release(self, window: Window, accepted: bool) -> None:
        """Hand out what was held back, and what comes from now on at once.

        Live estimates are replaced by the window's present ones: none was handed out before. Of a
        start that is not accepted, as it ended on trial, all are degraded.
        """
        held, self._held = self._held, None
        if held is None:
            return
        live = {estimate.stamp: estimate for estimate in held.take_live()}
        for interval in window.intervals:
            live |= {e.stamp: e for e in self._of_live(interval, live)}
        newest, smoothed = [self._rated(e) for e in live.values()], held.take_smoothed()
        if not accepted:
            newest, smoothed = _degraded(newest), _degraded(smoothed)
        self._output.put(newest, smoothed, held.take_lines())

    @property
    def _out(self) -> Output:
        return self._output if self._held is None else self._held

    def report_live(
        self,
        window: Window,
        frame: FrameTime,
        state: gtsam.NavState,
        covariances: Covariances,
        status: Status,
        lines: int,
        time_offset: TimeOffset,
    ) -> Estimate:
        """The estimate of the latest frame, whose state has these covariances, and this status
        but for them.
        """
        node = window.newest
        at_state = frame.time == node.time
        pose, velocity = self._at_stamp(state, node.bias, frame.time)
        estimate = Estimate(
            stamp=frame.stamp,
            world_T_body=pose,
            velocity=velocity,
            bias=node.bias,
            covariances=covariances,
            lines=lines,
            status=status,
            at_state=at_state,
            segment=self._segment,
            time_offset=time_offset,
            innovation=window.innovation if at_state else None,
        )
        self._live_by_stamp[frame.stamp] = estimate
        rated = self._rated(estimate)
        self._out.put(live=[rated if self._held is None else estimate])
        return rated

    def _rated(self, estimate: Estimate) -> Estimate:
        rated = self._monitor.rated(
            estimate.status, estimate.covariances, estimate.world_T_body, estimate.velocity
        )
        return replace(estimate, status=rated)

    def report_smoothed(
        self,
        window: Window,
        intervals: Sequence[Interval],
        time_offset: TimeOffset,
        degraded: bool = False,
    ) -> None:
        """The estimates of intervals' frames, and of the window's first frame; all `degraded` of a
        window that has failed.
        """
        for interval in intervals:
            found = self._of_interval(window, interval, time_offset)
            self._out.put(smoothed=_degraded(found) if degraded else found)

    def _of_interval(
        self, window: Window, interval: Interval, time_offset: TimeOffset
    ) -> Iterable[Estimate]:
        node = interval.node
        otherwise: Status = "degraded" if self._monitor.is_contradicted else "tracking"
        frames = self._states(interval)
        if node.index == 0:
            first = self._at_stamp(node.state, node.bias, node.time)
            frames = [_FrameState(window.first_stamp, *first, node.covariance), *frames]
        own = interval.stamps[0] if interval.repeats_frame else window.first_stamp
        at_states = (own, interval.stamps[-1])
        for stamp, pose, velocity, covariance in frames:
            live = self._live_by_stamp.pop(stamp, None)
            estimate = Estimate(
                stamp=stamp,
                world_T_body=pose,
                velocity=velocity,
                bias=node.bias,
                covariances=self._monitor.covariances(blocks(covariance), pose, velocity),
                lines=live.lines if live else 0,
                status=live.status if live else otherwise,
                at_state=stamp in at_states,
                segment=self._segment,
                time_offset=live.time_offset if live else time_offset,
            )
            yield self._rated(estimate)

    def _of_live(self, interval: Interval, live: Mapping[int, Estimate]) -> Iterable[Estimate]:
        """Live estimates of an interval's frames, by stamp, updated by the window."""
        for stamp, pose, velocity, covariance in self._states(interval):
            if stamp in live:
                yield replace(
                    live[stamp],
                    world_T_body=pose,
                    velocity=velocity,
                    bias=interval.node.bias,
                    covariances=self._monitor.covariances(blocks(covariance), pose, velocity),
                )

    def _states(self, interval: Interval) -> list[_FrameState]:
        """Of an interval's frames, without one that the interval after repeats: it begins with the
        state there, of which an unreliable IMU says little.
        """
        node, motion = interval.node, interval.motion
        if interval.is_rest_despite_imu:
            covariances = np.tile(node.covariance, (len(motion), 1, 1))
            velocities = np.tile(node.state.velocity(), (len(motion), 1))
        else:
            covariances = propagated_covariances(node, motion, self._imu, interval.noise)
            velocities = motion.velocities(node.state, node.bias, interval.gravity)
        states = zip(interval.stamps, interval.poses(), velocities, covariances, strict=True)
        found = [_FrameState(*state) for state in states]
        if self._middle_row_delay and not interval.is_rest_despite_imu:
            times = node.time + motion.elapsed + interval.residual_offset
            found = [
                self._moved_to_stamp(frame, node.bias, time)
                for frame, time in zip(found, times.tolist(), strict=True)
            ]
        return found[:-1] if interval.last_is_repeated else found

    def _moved_to_stamp(
        self, frame: _FrameState, bias: gtsam.imuBias.ConstantBias, time: float
    ) -> _FrameState:
        state = gtsam.NavState(frame.pose, frame.velocity)
        pose, velocity = self._at_stamp(state, bias, time)
        return frame._replace(pose=pose, velocity=velocity)

    def _at_stamp(
        self, state: gtsam.NavState, bias: gtsam.imuBias.ConstantBias, time: float
    ) -> tuple[gtsam.Pose3, FloatArray]:
        """Pose and velocity at a frame's stamp, from the state at its time, s."""
        if self._middle_row_delay:
            state = state_before(self._imu, state, bias, time, self._middle_row_delay)
        return state.pose(), state.velocity()

    def lines(self, landmarks: Iterable[Landmark]) -> None:
        """Lines that left the window."""
        estimates = (landmark.estimate(self._extent_outliers) for landmark in landmarks)
        known = [estimate for estimate in estimates if estimate is not None]
        self._out.put(lines=[replace(estimate, segment=self._segment) for estimate in known])


def _degraded(estimates: Iterable[Estimate]) -> list[Estimate]:
    return [replace(estimate, status="degraded") for estimate in estimates]
