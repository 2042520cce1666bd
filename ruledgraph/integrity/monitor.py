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
from ruledgraph.backend.states import Interval, Knot
from ruledgraph.calibration.sensors import FloatArray
from ruledgraph.core.estimates import Covariances
from ruledgraph.core.timing import Messages
from ruledgraph.integrity.segments import Drift
from ruledgraph_factors import STANDARD_GRAVITY

# The intervals of so many s are judged, but no fewer than so many; and so many lines in them, or
# nothing is concluded.
_SPAN, _FEWEST, _FEWEST_SEEN = 1.01, 5, 10
# Twice their error, on average: beyond what is usual, covariances grow with it, and shrink again in
# so long, s; images and IMU disagree from `_MOST` on, until it is below `_AGREED` again. Were all
# well it would have 15 degrees of freedom less those that are fitted. Simulated recordings usually
# have 1 and reach 4, MH_01 12 and 40; of a focal length that is 3 % off it is 90, of stamps that
# are off 100.
_USUAL, _FADES, _MOST, _AGREED = 3.0, 5.0, 45.0, 20.0
# The power of that error that covariances grow with: 1 were the contradiction white. Found on
# rendered EuRoC flights, whose NEES of position, orientation and velocity it takes from 4.5, 3.4,
# 3.7 to 1.2, 1.0, 1.0 (V1_01) and from 2.5, 6.8, 2.2 to 1.1, 2.9, 1.3 (MH_04).
_PERSISTS = 1.5
# Share of lines that do not fit, likewise: flights reach 0.12, blurred ones 0.28; an estimate that
# has run away begins at 0.3 and is lost when it is there for so long, s, or beyond `_LOST`.
_USUAL_MISFIT, _MOST_MISFIT, _FITTING = 0.1, 0.3, 0.2
_LOST, _LOST_FOR = 0.5, 1.0
# Lines are compared with their points in no fewer intervals in motion, and points of lines, than
# so many. The median of the absolute value of a standard normal variable.
_FEWEST_MOVING, _FEWEST_OFFSETS, _MEDIAN = 3, 20, 0.6745
# Where lines are closer to their points than they should be, covariances are no less than this
# share of what the window says: on rendered images lines are at a fifth, the IMU's noise is not.
_LEAST = 0.65
# Lines are parallel when all but this share of their directions' squares is along one; for so
# long, s, and no fewer than so many.
_SPREAD, _PARALLEL_FOR, _FEWEST_LINES = 0.02, 1.0, 2
# An estimate that moves by so much (m) while the body rests is worth a warning.
_SLIDE = 0.03
_G = -STANDARD_GRAVITY[2]
_UP = np.array([0.0, 0.0, 1.0])


class IntegrityMonitor:
    """Judges a segment knot by knot.

    Args:
        body_T_cam: the camera's mounting.
        drift: what is open of the segment's place and heading from the beginning.
        warnings: where to tell.
    """

    def __init__(self, body_T_cam: gtsam.Pose3, drift: Drift, warnings: Messages) -> None:
        self._body_T_cam = body_T_cam
        self._drift = drift
        self._warnings = warnings
        # Of the window's covariances: the share that stays where lines fit better than they should,
        # and how many times as large they are for all that is wrong.
        self._fit = self._excess = 1.0
        # In the world: the place's covariance by the window so far, and what it grew by.
        self._record = self._open_place = np.zeros((3, 3))
        self._contradiction = False
        self._misfit = 0.0
        self._misfit_since: float | None = None
        self._parallel_since: float | None = None
        self._along = np.zeros(3)
        self._at_first: tuple[float, float] = (0.0, 0.0)
        self._time = 0.0
        self._rest: FloatArray | None = None
        self._slide = np.zeros(3)
        # What is open of place and heading for all that is known by now.
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
        return since is not None and self._time - since >= _PARALLEL_FOR

    def update(self, window: Window, still: bool) -> None:
        """Take in the newest knot, optimised, and whether the body has been at rest until then."""
        elapsed, self._time = window.newest.time - self._time, window.newest.time
        excess = max(1.0, self._compare_with_imu(window), self._compare_with_lines(window, still))
        self._inflate(window.newest, excess, elapsed)
        self._look_at_directions(window)
        self._watch_rest(window.newest.state.position(), still)
        more = self._open_place - (self._excess - 1.0) * _of_place(window.newest)
        place = self._drift.place + self._open_along() + self._slid() + more
        self._open = replace(self._drift, place=place)

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
        error = imu_error(window)
        if error is None:
            return 1.0
        if error > _MOST and not self._contradiction:
            self._warnings.append(
                f"images and IMU disagree since {self._time:.2f} s: check time offset, extrinsics "
                "and the IMU's range"
            )
        self._contradiction = error > (_AGREED if self._contradiction else _MOST)
        return float((error / _USUAL) ** _PERSISTS)

    def _compare_with_lines(self, window: Window, still: bool) -> float:
        """Likewise how far lines are from their points, and the share of those that do not fit;
        most of them, and it is lost.
        """
        misfit, scale = misfit_share(window), line_scale(window)
        if misfit is not None:
            self._misfit = misfit
            if misfit > _MOST_MISFIT and self._misfit_since is None:
                self._misfit_since = self._time
                self._warnings.append(
                    f"{misfit:.0%} of the lines do not fit the estimate at {self._time:.2f} s: it "
                    "may be lost, or much of the image moves"
                )
            elif misfit < _FITTING:
                self._misfit_since = None
        since = self._misfit_since
        is_long = since is not None and self._time - since >= _LOST_FOR
        # Where there are too few to judge by now, the others were lost; or nobody looks, at rest.
        judged = misfit is not None or not still
        self.lost = judged and self._misfit > (_MOST_MISFIT if is_long else _LOST)
        excess = 1.0 if scale is None else scale**2
        self._fit = min(max(excess, _LEAST), 1.0)
        return excess if misfit is None else max(excess, (misfit / _USUAL_MISFIT) ** 2)

    def _inflate(self, knot: Knot, excess: float, elapsed: float) -> None:
        disagreed, self.disagree = self.disagree, self._contradiction or self.misfits
        place = _of_place(knot)
        if disagreed and not self.disagree:
            # What went wrong meanwhile stays.
            up = knot.state.attitude().matrix().T @ _UP
            self._drift = self._drift.grown(
                _enclosing(self._open_place, (self._excess - 1.0) * place),
                (self._excess - 1.0) * float(up @ knot.covariances[0][:3, :3] @ up),
                knot.state.position(),
            )
            self._excess, self._open_place = 1.0, np.zeros((3, 3))
        fading = 1.0 if self.disagree else float(np.exp(-elapsed / _FADES))
        self._excess = max(excess, fading * self._excess)
        # What went wrong with the place stays: as much as now, and what comes as it drifts on.
        record = _enclosing(self._record, place)
        came = (self._excess - 1.0) * (record - self._record)
        self._open_place = _enclosing(self._open_place + came, (self._excess - 1.0) * place)
        self._record = record

    # -- parallel lines --------------------------------------------------------------------------

    def _look_at_directions(self, window: Window) -> None:
        directions = directions_in_view(window)
        values, vectors = np.linalg.eigh(directions.T @ directions / max(len(directions), 1))
        # Too few lines are another matter, and end nothing.
        if len(directions) < _FEWEST_LINES:
            return
        if values[-1] < 1.0 - _SPREAD:
            self._drift = replace(self._drift, place=self._drift.place + self._open_along())
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
        """Covariance of the place that parallel lines leave open since they are parallel."""
        if self._parallel_since is None or not self.parallel:
            return np.zeros((3, 3))
        elapsed = self._time - self._parallel_since
        speed, force = self._at_first
        variance = speed * elapsed**2 + 0.25 * force * elapsed**4
        return variance * np.outer(self._along, self._along)

    # -- rest ------------------------------------------------------------------------------------

    def _watch_rest(self, place: FloatArray, still: bool) -> None:
        """As far as the estimate moves while the body rests, it is wrong, and stays so."""
        if not still:
            if self._rest is not None:
                self._drift = replace(self._drift, place=self._drift.place + self._slid())
                self._rest, self._slide = None, np.zeros(3)
            return
        if self._rest is None:
            self._rest = place
        before, self._slide = self._slide, place - self._rest
        if np.linalg.norm(before) < _SLIDE <= np.linalg.norm(self._slide):
            self._warnings.append(
                f"the estimate has moved by {np.linalg.norm(self._slide):.2f} m at "
                f"{self._time:.2f} s, and the camera has not: lines may be wrong"
            )

    def _slid(self) -> FloatArray:
        """Covariance of the place that says so."""
        return np.outer(self._slide, self._slide)


def imu_error(window: Window) -> float | None:
    """Twice the error of the last IMU factors, on average, but for the newest one, which hardly
    anything contradicts yet; None if there are too few.
    """
    intervals = _last(list(window.intervals), window)
    if len(intervals) < _FEWEST:
        return None
    values = gtsam.Values()
    for interval in intervals:
        knot = interval.knot
        values.insert(X(knot.index), knot.state.pose())
        values.insert(V(knot.index), knot.state.velocity())
        values.insert(B(knot.index), knot.bias)
    errors = [interval.imu_factors[0].error(values) for interval in intervals[:-1]]
    return 2.0 * float(np.mean(errors))


def misfit_share(window: Window) -> float | None:
    """Share of the last intervals' lines that did not fit; None if there are too few."""
    # At rest most do not look at any.
    looked = [i for i in window.intervals if i.offsets or not i.still]
    intervals = _last(looked, window)
    judged = sum(len(interval.offsets) for interval in intervals)
    misfits = sum(interval.misfits for interval in intervals)
    return misfits / judged if judged >= _FEWEST_SEEN else None


def line_scale(window: Window) -> float | None:
    """How many times further off than they should be the last intervals' lines are, as a whole,
    while the body moves; None if there are too few.
    """
    intervals = _last([i for i in window.intervals if i.offsets and not i.still], window)
    offsets = [offset for interval in intervals for offset in interval.offsets]
    if len(intervals) < _FEWEST_MOVING or len(offsets) < _FEWEST_OFFSETS:
        return None
    return float(np.median(np.abs(offsets))) / _MEDIAN


def _of_place(knot: Knot) -> FloatArray:
    """Covariance of the body's place in the world, as the window gives it."""
    R = knot.state.attitude().matrix()
    return np.asarray(R @ knot.covariances[0][3:, 3:] @ R.T)


def _enclosing(one: FloatArray, other: FloatArray) -> FloatArray:
    """A covariance that is nowhere smaller than either."""
    values, vectors = np.linalg.eigh(one - other)
    return np.asarray(other + (vectors * np.maximum(values, 0.0)) @ vectors.T)


def _last(intervals: Sequence[Interval], window: Window) -> Sequence[Interval]:
    recent = sum(i.knot.time >= window.newest.time - _SPAN for i in intervals)
    return intervals[-max(recent, _FEWEST) :]


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
