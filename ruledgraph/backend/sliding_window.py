# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The window: states, the graph between them, and its solution."""

import math
from collections import deque
from collections.abc import Collection, Sequence

from ruledgraph.backend.bias_jump import JumpTest, bias_jump
from ruledgraph.backend.graph_update import GraphUpdate
from ruledgraph.backend.imu_intervals import add_bias_jump, imu_interval
from ruledgraph.backend.innovation import ImuPredictions
from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.line_manager import LineManager
from ruledgraph.backend.rest_factors import rest_factors
from ruledgraph.backend.rest_jump import rest_jump
from ruledgraph.backend.self_calibration import SelfCalibration
from ruledgraph.backend.start import Start
from ruledgraph.backend.state_sequence import StateSequence
from ruledgraph.backend.states import Interval, LineObservation, StateNode, joint_prior
from ruledgraph.backend.window_solver import WindowSolver
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.calibration_estimates import Extrinsics, FocalRatio
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Innovation
from ruledgraph.core.line_observations import LineTrack
from ruledgraph.imu.buffer import ImuBuffer
from ruledgraph.synchronization.frame_history import FrameTime


class Window:
    """Fixed-lag smoothing over states and lines.

    Use `extend` for each new state, then `optimize`. `offset_correction` (s) was added to the
    calibration's time offset in the times of the start's frames. `extrinsics`: what is known of the
    camera's pose in the body, `focal_ratio`: of its focal length over the calibration's; None:
    those of the calibration, not to be estimated.
    """

    def __init__(
        self,
        calibration: Calibration,
        config: Config,
        start: Start,
        offset_correction: float = 0.0,
        extrinsics: Extrinsics | None = None,
        focal_ratio: FocalRatio | None = None,
    ) -> None:
        self._config = config
        self._imu_noise = calibration.imu_noise
        first = StateNode(0, start.time, start.state, start.bias, start.covariance)
        self._states = StateSequence(first)
        self.line_manager = LineManager(calibration, config, start)
        self._solver = WindowSolver(self._states, self.line_manager, config)
        offset = start.time_offset
        self.self_calibration = SelfCalibration(
            None if offset is None else offset.plus(offset_correction), extrinsics, focal_ratio
        )
        """As of the newest interval that was solved."""
        self.first_stamp = start.stamp
        self.solved = -math.inf
        """Time of the newest state that was optimised, s."""
        self.innovation: Innovation | None = None
        """Of the newest state, see `Estimate.innovation`."""
        self.jump_test: JumpTest | None = None
        """Whether the IMU's biases jumped in the newest interval; None if that cannot be told."""
        self._predictions = ImuPredictions(config.integrity.innovation_span)
        self._update = GraphUpdate()
        self._update.factors.add(joint_prior(first))
        self._update.insert(first)

    @property
    def nodes(self) -> deque[StateNode]:
        """The states, oldest first."""
        return self._states.nodes

    @property
    def intervals(self) -> deque[Interval]:
        """Between the states."""
        return self._states.intervals

    @property
    def newest(self) -> StateNode:
        """The latest state."""
        return self._states.newest

    @property
    def lines(self) -> dict[int, Landmark]:
        """The lines of the graph by their ids."""
        return self.line_manager.lines

    @property
    def edge_sigma_px(self) -> float:
        """Standard deviation of an edge point as found by now, px."""
        return self._config.edges.sigma_px * math.sqrt(self.line_manager.weights.edge_variance)

    @property
    def recoveries(self) -> list[str]:
        """Why the smoother had to be rebuilt, each time."""
        return self._solver.recoveries

    @property
    def rests_since(self) -> float:
        """Time of the first state of the rest that goes on, or of the newest state, s."""
        return self._states.rests_since

    @property
    def jumped(self) -> bool:
        """Whether the IMU's biases jumped in the newest interval."""
        return self.jump_test is not None and self.jump_test.jumped

    def is_plausible(self) -> bool:
        """Whether the newest state can be one of a carried or flown camera and its IMU."""
        return not self._solver.has_failed and self.newest.is_plausible(self._config.integrity)

    # -- growing ---------------------------------------------------------------------------------

    def extend(
        self,
        frames: Sequence[FrameTime],
        imu: ImuBuffer,
        tracks: Collection[LineTrack],
        still: bool,
        offset_correction: float = 0.0,
        jump_threshold: float = math.inf,
    ) -> None:
        """Add a state at the last of the frames that follow the newest one, with its factors.

        Args:
            frames: in order of time, after the newest state.
            imu: samples that cover them.
            tracks: of the lines to be taken in, usually all.
            still: whether the body has rested since the newest state, and for some time.
            offset_correction: what was added to the calibration's time offset in their times, s.
            jump_threshold: from which likelihood ratio on the biases jump, see `bias_jump`; -inf:
                they do, if any line of known distance was seen; inf: they do not, nor at rest
                (`rest_jump`).
        """
        interval, new = self._next_interval(frames, imu, still, offset_correction)
        known = self._test_for_jump(interval, imu, tracks, still, jump_threshold)
        if self.jump_test and self.jump_test.jumped:
            jump = self.jump_test.jump
            add_bias_jump(interval, new, jump, imu, self._imu_noise, self._config.start)
            self._predictions.restart(new.time)
            known = {}
        self.innovation = None
        if interval.node.time == self.solved:
            self._predictions.begin_at(interval.node)
        self._predictions.carry_on(interval, new.time, imu, self._imu_noise)
        self._append(interval, new)
        self.line_manager.observe(tracks, self.intervals, new.time, self._update, known)

    def _next_interval(
        self, frames: Sequence[FrameTime], imu: ImuBuffer, still: bool, offset_correction: float
    ) -> tuple[Interval, StateNode]:
        before, latest, config = self.newest, self._states.latest_interval, self._config
        repeats_frame = False
        if latest is not None and not latest.is_reliable and not imu.in_long_dropout(before.time):
            repeats_frame = latest.last_is_repeated = True
            frames = [FrameTime(latest.stamps[-1], before.time), *frames]
        last, period = self._states.latest_camera, config.window.camera_period
        camera = self.self_calibration.variables(
            before.index, before.time, offset_correction, last, period
        )
        scale_sigma = config.imu.accelerometer_scale_sigma
        return imu_interval(
            before, frames, repeats_frame, imu, self._imu_noise, scale_sigma, camera, still
        )

    def _test_for_jump(
        self,
        interval: Interval,
        imu: ImuBuffer,
        tracks: Collection[LineTrack],
        still: bool,
        threshold: float,
    ) -> dict[int, LineObservation]:
        """Set `jump_test`; the observations of known lines that it needed."""
        is_tested = interval.is_reliable and not math.isinf(self.solved)
        seen = self.line_manager.observations_in(interval, tracks) if is_tested else {}
        model, observed = self.line_manager.model, list(seen.values())
        test = bias_jump(interval, observed, model, threshold, self._config)
        if still and is_tested and threshold < math.inf and not (test and test.jumped):
            of_rest = rest_jump(interval, imu, self._imu_noise, self._config)
            test = of_rest if of_rest and of_rest.jumped else test
        self.jump_test = test
        return seen

    def _append(self, interval: Interval, new: StateNode) -> None:
        self._update.factors.add(interval.imu_factor)
        self._update.insert_camera(interval, self._states.latest_camera, self._config)
        self._states.append(interval, new)
        self._update.insert(new)
        for factor in rest_factors(self.intervals, new.time, self._config.rest):
            self._update.factors.add(factor)

    # -- solving ---------------------------------------------------------------------------------

    def optimize(self) -> list[Interval]:
        """Take in what was added since the last time.

        Returns:
            The intervals that left the window, with their final estimates.
        """
        gone = self._drop_old()
        self._solver.solve(self._update)
        self._update = GraphUpdate()
        self.solved = self.newest.time
        self.innovation = self._predictions.innovation(self.newest)
        self.self_calibration = SelfCalibration.of(self.intervals[-1].camera)
        self.line_manager.check_fit(self.intervals[-1])
        self.line_manager.weights.update(self.intervals, self.lines.values())
        return gone

    def _drop_old(self) -> list[Interval]:
        oldest = self.newest.time - self._config.window.lag
        gone = []
        while (interval := self._states.pop_before(oldest)) is not None:
            self._solver.read_covariance(interval.node)
            gone.append(interval)
            for seen in interval.observations:
                seen.line.linearization_frozen = True
        self.line_manager.retire(oldest)
        return gone

    def read_smoothed_covariances(self) -> None:
        """Of all states, as they are known now."""
        for node in self.nodes:
            self._solver.read_covariance(node)
