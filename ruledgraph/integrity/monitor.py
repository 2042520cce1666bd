# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How far estimates may be believed beyond what the window says of them.

Four things the window cannot know: that images and IMU contradict each other or lines miss their
points, where every factor is as certain as its noise figures say; that it is lost, where the robust
loss gives up most lines and what is left agrees; that lines which are all parallel leave the motion
along them to the IMU, where marginals of factors that were linearised elsewhere say otherwise; and
that it moves a body which rests.
"""

from collections.abc import Sequence
from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from ruledgraph.backend.sliding_window import Window
from ruledgraph.backend.states import Interval, StateNode
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config, IntegrityConfig
from ruledgraph.core.estimates import Covariances
from ruledgraph.core.timing import Messages
from ruledgraph.integrity.segments import Drift
from ruledgraph_factors import STANDARD_GRAVITY

# The median of the absolute value of a standard normal variable.
_MEDIAN = 0.6745
_G = -STANDARD_GRAVITY[2]
_UP = np.array([0.0, 0.0, 1.0])


class IntegrityMonitor:
    """Judges a segment state by state.

    Args:
        drift: what is open of the segment's position and heading from the beginning.
        warnings: where to tell.
        config: all settings.
    """

    def __init__(self, drift: Drift, warnings: Messages, config: Config) -> None:
        self._config = config.integrity
        self._slide_warning = config.rest.slide_warning
        self._drift = drift
        self._warnings = warnings
        # Of the window's covariances: the share that stays where lines fit better than they should,
        # and how many times as large they are for all that is wrong.
        self._fit = self._excess = 1.0
        # In the world: the position's covariance by the window so far, and what it grew by.
        self._record = self._open_position = np.zeros((3, 3))
        self._contradiction = False
        self._misfit = 0.0
        self._misfit_since: float | None = None
        self._parallel_since: float | None = None
        self._along = np.zeros(3)
        self._at_first: tuple[float, float] = (0.0, 0.0)
        self._time = 0.0
        self._rest: FloatArray | None = None
        self._slide = np.zeros(3)
        # What is open of position and heading for all that is known by now.
        self._open = drift
        self.disagree = False
        """Whether images and IMU do, or lines and estimate."""
        self.lost = False
        """Whether most lines do not fit the estimate."""

    @property
    def misfits(self) -> bool:
        """Whether too many lines do not fit the estimate."""
        return self._misfit_since is not None

    @property
    def parallel(self) -> bool:
        """Whether all lines have been parallel for long."""
        since = self._parallel_since
        return since is not None and self._time - since >= self._config.parallel_time

    def update(self, window: Window, still: bool) -> None:
        """Take in the newest state, optimised, and whether the body has been at rest until then."""
        elapsed, self._time = window.newest.time - self._time, window.newest.time
        excess = max(1.0, self._compare_with_imu(window), self._compare_with_lines(window, still))
        self._inflate(window.newest, excess, elapsed)
        self._look_at_directions(window)
        self._watch_rest(window.newest.state.position(), still)
        more = self._open_position - (self._excess - 1.0) * _of_position(window.newest)
        position = self._drift.position + self._open_along() + self._slid() + more
        self._open = replace(self._drift, position=position)

    def covariances(
        self, covariances: Covariances, pose: gtsam.Pose3, velocity: FloatArray
    ) -> Covariances:
        """Those of a state as the window gives them, made honest."""
        of_pose, of_velocity, of_bias = covariances
        # Of the bias lines say little.
        times = self._fit + self._excess - 1.0
        scaled = times * of_pose, times * of_velocity, self._excess * of_bias
        return self._open.added(scaled, pose, velocity)

    # -- images, IMU and lines -------------------------------------------------------------------

    def _compare_with_imu(self, window: Window) -> float:
        """By how much the IMU factors' error says that covariances are too small."""
        error, limits = imu_error(window, self._config), self._config
        if error is None:
            return 1.0
        if error > limits.max_error and not self._contradiction:
            self._warnings.append(
                f"images and IMU disagree since {self._time:.2f} s: check time offset, extrinsics "
                "and the IMU's range"
            )
        self._contradiction = error > (
            limits.agreed_error if self._contradiction else limits.max_error
        )
        return float((error / limits.usual_error) ** limits.error_exponent)

    def _compare_with_lines(self, window: Window, still: bool) -> float:
        """Likewise how far lines are from their points, and the share of those that do not fit;
        most of them, and it is lost.
        """
        limits = self._config
        misfit, scale = misfit_share(window, limits), line_scale(window, limits)
        if misfit is not None:
            self._misfit = misfit
            if misfit > limits.max_misfit and self._misfit_since is None:
                self._misfit_since = self._time
                self._warnings.append(
                    f"{misfit:.0%} of the lines do not fit the estimate at {self._time:.2f} s: it "
                    "may be lost, or much of the image moves"
                )
            elif misfit < limits.agreed_misfit:
                self._misfit_since = None
        since = self._misfit_since
        is_long = since is not None and self._time - since >= limits.lost_time
        # Where there are too few to judge by now, the others were lost; or nobody looks, at rest.
        judged = misfit is not None or not still
        self.lost = judged and self._misfit > (limits.max_misfit if is_long else limits.lost_misfit)
        excess = 1.0 if scale is None else scale**2
        self._fit = min(max(excess, limits.min_covariance_share), 1.0)
        return excess if misfit is None else max(excess, (misfit / limits.usual_misfit) ** 2)

    def _inflate(self, node: StateNode, excess: float, elapsed: float) -> None:
        disagreed, self.disagree = self.disagree, self._contradiction or self.misfits
        position = _of_position(node)
        if disagreed and not self.disagree:
            # What went wrong meanwhile stays.
            up = node.state.attitude().matrix().T @ _UP
            self._drift = self._drift.grown(
                _enclosing(self._open_position, (self._excess - 1.0) * position),
                (self._excess - 1.0) * float(up @ node.covariances[0][:3, :3] @ up),
                node.state.position(),
            )
            self._excess, self._open_position = 1.0, np.zeros((3, 3))
        fading = 1.0 if self.disagree else float(np.exp(-elapsed / self._config.fade_time))
        self._excess = max(excess, fading * self._excess)
        # What went wrong with the position stays: as much as now, and what comes as it drifts on.
        record = _enclosing(self._record, position)
        came = (self._excess - 1.0) * (record - self._record)
        self._open_position = _enclosing(
            self._open_position + came, (self._excess - 1.0) * position
        )
        self._record = record

    # -- parallel lines --------------------------------------------------------------------------

    def _look_at_directions(self, window: Window) -> None:
        directions = directions_in_view(window)
        values, vectors = np.linalg.eigh(directions.T @ directions / max(len(directions), 1))
        # Too few lines are another matter, and end nothing.
        if len(directions) < self._config.min_lines:
            return
        if values[-1] < 1.0 - self._config.parallel_spread:
            self._drift = replace(self._drift, position=self._drift.position + self._open_along())
            self._parallel_since = None
            return
        self._along = vectors[:, -1]
        if self._parallel_since is None:
            self._parallel_since = self._time
            of_pose, of_velocity, of_bias = (self._excess * c for c in window.newest.covariances)
            speed = float(self._along @ of_velocity @ self._along)
            tilt = float(np.trace(of_pose[:3, :3])) / 2.0
            force = float(np.linalg.eigvalsh(of_bias[:3, :3])[-1]) + _G**2 * tilt
            self._at_first = (speed, force)

    def _open_along(self) -> FloatArray:
        """Covariance of the position that parallel lines leave open since they are parallel."""
        if self._parallel_since is None or not self.parallel:
            return np.zeros((3, 3))
        elapsed = self._time - self._parallel_since
        speed, force = self._at_first
        variance = speed * elapsed**2 + 0.25 * force * elapsed**4
        return variance * np.outer(self._along, self._along)

    # -- rest ------------------------------------------------------------------------------------

    def _watch_rest(self, position: FloatArray, still: bool) -> None:
        """As far as the estimate moves while the body rests, it is wrong, and stays so."""
        if not still:
            if self._rest is not None:
                self._drift = replace(self._drift, position=self._drift.position + self._slid())
                self._rest, self._slide = None, np.zeros(3)
            return
        if self._rest is None:
            self._rest = position
        before, self._slide = self._slide, position - self._rest
        if np.linalg.norm(before) < self._slide_warning <= np.linalg.norm(self._slide):
            self._warnings.append(
                f"the estimate has moved by {np.linalg.norm(self._slide):.2f} m at "
                f"{self._time:.2f} s, and the camera has not: lines may be wrong"
            )

    def _slid(self) -> FloatArray:
        """Covariance of the position that says so."""
        return np.outer(self._slide, self._slide)


def imu_error(window: Window, config: IntegrityConfig) -> float | None:
    """Twice the error of the last IMU factors, on average, but for the newest one, which hardly
    anything contradicts yet; None if there are too few.
    """
    intervals = _last(list(window.intervals), window, config)
    if len(intervals) < config.min_intervals:
        return None
    values = gtsam.Values()
    for interval in intervals:
        node = interval.node
        values.insert(X(node.index), node.state.pose())
        values.insert(V(node.index), node.state.velocity())
        values.insert(B(node.index), node.bias)
    errors = [interval.imu_factors[0].error(values) for interval in intervals[:-1]]
    return 2.0 * float(np.mean(errors))


def misfit_share(window: Window, config: IntegrityConfig) -> float | None:
    """Share of the last intervals' lines that did not fit; None if there are too few."""
    # At rest most do not look at any.
    looked = [i for i in window.intervals if i.offsets or not i.still]
    intervals = _last(looked, window, config)
    judged = sum(len(interval.offsets) for interval in intervals)
    misfits = sum(interval.misfits for interval in intervals)
    return misfits / judged if judged >= config.min_observations else None


def line_scale(window: Window, config: IntegrityConfig) -> float | None:
    """How many times further off than they should be the last intervals' lines are, as a whole,
    while the body moves; None if there are too few.
    """
    moving = [i for i in window.intervals if i.offsets and not i.still]
    intervals = _last(moving, window, config)
    offsets = [offset for interval in intervals for offset in interval.offsets]
    if len(intervals) < config.min_moving_intervals or len(offsets) < config.min_offsets:
        return None
    return float(np.median(np.abs(offsets))) / _MEDIAN


def _of_position(node: StateNode) -> FloatArray:
    """Covariance of the body's position in the world, as the window gives it."""
    R = node.state.attitude().matrix()
    return np.asarray(R @ node.covariances[0][3:, 3:] @ R.T)


def _enclosing(one: FloatArray, other: FloatArray) -> FloatArray:
    """A covariance that is nowhere smaller than either."""
    values, vectors = np.linalg.eigh(one - other)
    return np.asarray(other + (vectors * np.maximum(values, 0.0)) @ vectors.T)


def _last(
    intervals: Sequence[Interval], window: Window, config: IntegrityConfig
) -> Sequence[Interval]:
    recent = sum(i.node.time >= window.newest.time - config.span for i in intervals)
    return intervals[-max(recent, config.min_intervals) :]


def directions_in_view(window: Window) -> FloatArray:
    """Unit directions in the world of the window's lines that were seen last, (N, 3)."""
    found = []
    for line in window.lines.values():
        if line.in_view:
            direction = line.plucker[0][3:]
            length = np.linalg.norm(direction)
            if length > 0.0:
                found.append(direction / length)
    return np.array(found).reshape(-1, 3)
