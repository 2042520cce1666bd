# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The window: knots, the graph between them, and the lines that enter and leave it."""

import math
from collections import deque
from collections.abc import Iterable, Sequence

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, L, V, X

from ruledgraph.backend.fixed_lag_smoother import FixedLagSmoother, SmootherError
from ruledgraph.backend.landmarks import GraphLine, note_reach
from ruledgraph.backend.recovery import known_of
from ruledgraph.backend.states import (
    Interval,
    Knot,
    Observation,
    Start,
    add_priors,
    insert_state,
    of_new_line,
    rest_factors,
    resting,
)
from ruledgraph.backend.time_offset import OffsetLink
from ruledgraph.backend.triangulation import triangulate
from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.config import Config
from ruledgraph.frontend.tracks import Track, compressed_points
from ruledgraph.imu.buffer import ImuBuffer, params_across
from ruledgraph_factors import (
    FactorError,
    preintegrate_frames,
    ruled_surface_factor,
    ruled_surface_factor_with_time_offset,
    same_line_factor,
)

# A line that misses its points by so much (px, root mean square) in so many knots in a row goes;
# one that does so at once does not enter.
_BAD_MISFIT, _BAD_KNOTS, _NEW_MISFIT = 2.0, 2, 1.5
_FEWEST_SIGHTINGS = 3
# Closer to its first camera than this a line is taken for an error, 1/m.
_NEAREST_INVERSE = 20.0
# An estimate that departs from the IMU's prediction by more has diverged (m, m/s); by more than
# this, it may have moved beyond where its factors are linear.
_JUMP, _VELOCITY_JUMP = 1.0, 3.0
_STEP, _VELOCITY_STEP = 0.003, 0.010
# Beyond these the estimate has run away: m/s, and biases in rad/s and m/s^2.
_FASTEST, _WORST_GYROSCOPE, _WORST_ACCELEROMETER = 50.0, 0.5, 3.0
# A line this far (rad) from where its factors are linearised gets a new variable.
_MOVED = 0.1
# What is known of a new line until the smoother says it.
_NEW_LINE = np.diag([0.1, 0.1, 2.5e-4, 2.5e-4])
# Lines whose covariance is computed anew at a knot; each takes as long as ten factors.
_COVARIANCES = 4


class Window:
    """Fixed-lag smoothing over knots and lines.

    Use `extend` for each new knot, then `optimize`. `correction` is what the start's frames were
    timed with beyond the calibration's time offset, s.
    """

    def __init__(
        self, calibration: Calibration, config: Config, start: Start, correction: float = 0.0
    ) -> None:
        self._body_T_cam = calibration.body_T_cam
        self._config = config
        self._imu_noise = calibration.imu_noise
        self._imu_params = calibration.imu_noise.preintegration_params()
        self._focal = calibration.camera.focal_length
        self._deviation = config.edges.deviation / self._focal
        self._smoother = self._fresh_smoother()
        covariances = (
            start.pose_covariance,
            np.eye(3) * start.velocity_sigma**2,
            np.diag(np.square(start.bias_sigmas)),
        )
        first = Knot(0, start.time, start.state, start.bias, covariances)
        self.time_offset = start.time_offset
        """Beyond the calibration's, as of the newest interval, when it is estimated."""
        if start.time_offset is not None:
            self.time_offset = start.time_offset.moved(correction)
        self.first_stamp = start.stamp
        self.knots = deque([first])
        self.intervals: deque[Interval] = deque()
        self.lines: dict[int, GraphLine] = {}
        """By track number."""
        self.retired: list[GraphLine] = []
        """Lines that left, until someone takes them."""
        self.recoveries: list[str] = []
        """Why the window had to be rebuilt, each time."""
        self.solved = -math.inf
        """Time of the newest knot that was optimised, s."""
        self._broken = False
        self._known_lines = dict(start.lines)
        self._lines_so_far = 0
        self._clear_news()
        add_priors(self._new_factors, first)
        self._insert(first)

    def _fresh_smoother(self, careful: bool = False) -> FixedLagSmoother:
        return FixedLagSmoother(self._config.window.lag, self._config.window.updates, careful)

    def _clear_news(self) -> None:
        self._new_factors = gtsam.NonlinearFactorGraph()
        self._new_values = gtsam.Values()
        self._new_times: dict[int, float] = {}

    def _insert(self, knot: Knot) -> None:
        insert_state(self._new_values, knot)
        self._new_times |= {key(knot.index): knot.time for key in (X, V, B)}

    @property
    def newest(self) -> Knot:
        """The latest knot."""
        return self.knots[-1]

    @property
    def rests_since(self) -> float:
        """Time of the first knot of the rest that goes on, or of the newest knot, s."""
        rest = resting(self.intervals)
        return rest[-1].knot.time if rest else self.newest.time

    def is_plausible(self) -> bool:
        """Whether the newest state can be one of a carried or flown camera and its IMU."""
        knot = self.newest
        return not self._broken and bool(
            np.linalg.norm(knot.state.velocity()) < _FASTEST
            and np.linalg.norm(knot.bias.gyroscope()) < _WORST_GYROSCOPE
            and np.linalg.norm(knot.bias.accelerometer()) < _WORST_ACCELEROMETER
        )

    # -- growing ---------------------------------------------------------------------------------

    def extend(
        self,
        stamps: Sequence[int],
        times: Sequence[float],
        imu: ImuBuffer,
        tracks: Iterable[Track],
        still: bool,
        correction: float = 0.0,
    ) -> None:
        """Add a knot at the last of the frames that follow the newest knot, with its factors.

        Args:
            stamps: of the frames, ns.
            times: of the frames, s, increasing, after the newest knot.
            imu: samples that cover them.
            tracks: of the lines to be taken in, usually all.
            still: whether the body has rested since the newest knot, and for some time.
            correction: of the calibration's time offset, that `times` were computed with, s.
        """
        knot = self.newest
        k = knot.index
        unplaced = bool(self.intervals) and not self.intervals[-1].is_known
        again = int(unplaced and not imu.is_lost(knot.time))
        if again:
            stamps, times = [self.intervals[-1].stamps[-1], *stamps], [knot.time, *times]
        samples = imu.between(knot.time, times[-1])
        params, known = self._imu_params, len(times)
        doubts = imu.doubts(knot.time, times[-1])
        if doubts:
            params = params_across(self._imu_noise, doubts, knot.time, times[-1])
            first = min(doubt.start for doubt in doubts)
            known = max(again, sum(time <= first for time in times))
        preintegrated = gtsam.PreintegratedCombinedMeasurements(params, knot.bias)
        for segment in samples.segments(knot.time, times[-1], at=times, bias=knot.bias):
            preintegrated.integrateMeasurement(*segment)
        if still:
            state = gtsam.NavState(knot.state.pose(), np.zeros(3))
        else:
            state = preintegrated.predict(knot.state, knot.bias)
        new = Knot(k + 1, times[-1], state, knot.bias, knot.covariances)
        imu_factor = gtsam.CombinedImuFactor(
            X(k), V(k), X(k + 1), V(k + 1), B(k), B(k + 1), preintegrated
        )
        self._new_factors.add(imu_factor)
        link = self._new_link(knot, correction)
        # At rest the noise of the gyroscope would feign knowledge of the offset.
        timed = link is not None and not still
        motion = preintegrate_frames(samples, knot.time, times, knot.bias, with_time=timed)
        interval = Interval(knot, list(stamps), motion, [imu_factor], known, again, link, still)
        self.intervals.append(interval)
        self.knots.append(new)
        self._insert(new)
        for factor in rest_factors(self.intervals, new.time):
            self._new_factors.add(factor)
        for track in tracks:
            line = self.lines.get(track.number)
            if line is not None:
                self._observe(interval, line)
            elif self._is_ripe(track, new.time):
                self._enter(track)

    def _new_link(self, knot: Knot, correction: float) -> OffsetLink | None:
        """The time offset of the frames after a knot, tied to that of the interval before."""
        if self.time_offset is None:
            return None
        value, sigma = self.time_offset
        link = OffsetLink(knot.index, knot.time, correction, value - correction, sigma)
        before = self.intervals[-1].link if self.intervals else None
        walk = self._config.time_offset.walk
        self._new_factors.add(link.tie(before, walk) if before else link.prior())
        self._new_values.insert(link.key, link.shift)
        self._new_times[link.key] = link.time
        return link

    def _is_ripe(self, track: Track, time: float) -> bool:
        followed = time - track.born >= self._config.window.follow_first
        return track.number in self._known_lines or (followed and track.misses == 0)

    def _observe(self, interval: Interval, line: GraphLine) -> None:
        """The factor of a line over the frames of an interval that saw it."""
        index, sightings = interval.seen(line.track)
        if not index:
            return
        compressed = compressed_points(sightings)
        noise: noiseModel.Base = noiseModel.Isotropic.Sigma(compressed.rows, self._deviation)
        if self._config.window.robust > 0.0:
            # The whitened norm of a line that is off by `robust` px in every frame.
            size = self._config.window.robust / self._config.edges.deviation
            size *= np.sqrt(compressed.weight)
            noise = noiseModel.Robust.Create(noiseModel.mEstimator.Cauchy.Create(size), noise)
        k = interval.knot.index
        is_whole = len(index) == len(interval.stamps)
        motion = interval.motion if is_whole else interval.motion.select(index)
        rest = motion, line.chart, compressed, self._body_T_cam
        if interval.link is None or motion.time_jacobian is None:
            factor = ruled_surface_factor(noise, X(k), V(k), B(k), line.key, *rest)
        else:
            keys = X(k), V(k), B(k), interval.link.key, line.key
            factor = ruled_surface_factor_with_time_offset(noise, *keys, *rest)
        last = index[-1], sightings[-1].points
        interval.observations.append(Observation(line, factor, compressed, last))
        self._new_factors.add(factor)
        line.points += sum(len(sighting.points) for sighting in sightings)
        line.last_stamp = max(line.last_stamp, interval.stamps[index[-1]])
        line.last_time = self.newest.time
        self._new_times[line.key] = self.newest.time

    def _enter(self, track: Track) -> None:
        """Give a track a variable, with factors in all intervals that saw it."""
        seen = [(interval, *interval.seen(track)) for interval in self.intervals]
        seen = [s for s in seen if s[1]]
        if not seen:
            return
        known = self._known_lines.pop(track.number, None)
        if known is not None:
            chart, delta = known
        else:
            if sum(len(index) for _, index, _ in seen) < _FEWEST_SIGHTINGS:
                return
            cameras = []
            for interval, index, _ in seen:
                of_frames = interval.cameras(self._body_T_cam)
                cameras += [of_frames[i] for i in index]
            sightings = [sighting for _, _, part in seen for sighting in part]
            points = compressed_points(sightings)
            fit = triangulate(cameras, points, sightings[0].points, self._deviation)
            if fit is None or fit.misfit * self._focal > _NEW_MISFIT:
                return
            if fit.inverse < -2.0 * fit.inverse_sigma or fit.inverse > _NEAREST_INVERSE:
                track.give_up()
                return
            chart, delta = fit.chart, np.zeros(4)
        line = GraphLine(
            key=L(self._lines_so_far),
            track=track,
            chart=chart,
            delta=delta,
            linearized=delta,
            covariance=_NEW_LINE,
            first_stamp=seen[0][0].stamps[seen[0][1][0]],
            last_stamp=0,
            last_time=self.newest.time,
        )
        self._lines_so_far += 1
        self.lines[track.number] = line
        self._new_values.insert(line.key, delta)
        for interval, _, _ in seen:
            self._observe(interval, line)
        for factor in of_new_line(seen[0][0].knot, seen[0][0].observations[-1]):
            self._new_factors.add(factor)

    def _reanchor(self, line: GraphLine) -> None:
        """A new chart at the current estimate, under a new key that is tied to the old one.

        The smoother never linearises a variable anew whose neighbour has left the window. A line
        that was not seen from two places by then would keep a depth of which nothing was known.
        """
        old_key, key = line.key, L(self._lines_so_far)
        # The marginal that fixed the old variable knows it where it was linearised. Here, as far
        # from there as it has moved, what it leaves open (place and heading) looks a little
        # different: a tie closer than that would make it known, and tear at it.
        moved = float(np.abs(line.delta - line.linearized).max())
        noise = noiseModel.Isotropic.Sigma(4, moved)
        anchor = line.chart.world_T_anchor
        try:
            chart, by_delta = line.chart.reanchor(line.delta, anchor)
            factor = same_line_factor(noise, old_key, key, line.chart, line.delta, chart)
        except FactorError:
            return  # through its anchor: it will be judged
        self._lines_so_far += 1
        self._new_factors.add(factor)
        self._new_values.insert(key, np.zeros(4))
        self._new_times |= {old_key: line.last_time, key: line.last_time}
        line.covariance = by_delta @ line.covariance @ by_delta.T
        line.key, line.chart, line.delta = key, chart, np.zeros(4)
        line.linearized, line.fixed = line.delta, False

    # -- solving ---------------------------------------------------------------------------------

    def optimize(self) -> list[Interval]:
        """Take in what was added since the last time.

        Returns:
            The intervals that left the window, with their final estimates.
        """
        gone = self._drop_old()
        for line in self.lines.values():
            if line.fixed and np.abs(line.delta - line.linearized).max() > _MOVED:
                self._reanchor(line)
        was_careful = self._smoother.careful
        try:
            news = (self._new_factors, self._new_values, self._new_times)
            self._read(self._smoother.update(*news, self._check))
        except SmootherError as failure:
            self.recoveries.append(f"at {self.newest.time:.2f} s: {failure}")
            self._rebuild()
        else:
            if self._smoother.careful and not was_careful:
                trouble = f"at {self.newest.time:.2f} s: {self._smoother.trouble}"
                self.recoveries.append(f"{trouble}; solved by careful steps")
        self._clear_news()
        self.solved = self.newest.time
        self._read_covariances()
        self._judge()
        return gone

    def _drop_old(self) -> list[Interval]:
        oldest = self.newest.time - self._config.window.lag
        gone = []
        while self.intervals and self.intervals[0].knot.time < oldest:
            interval = self.intervals.popleft()
            gone.append(interval)
            self.knots.popleft()
            for line, factor, _, _ in interval.observations:
                line.fixed |= factor.spec.keys[-1] == line.key
        for number in [n for n, line in self.lines.items() if line.last_time < oldest]:
            self.retired.append(self.lines.pop(number))
        return gone

    def _read(self, estimate: gtsam.Values) -> None:
        for knot in self.knots:
            pose, velocity = estimate.atPose3(X(knot.index)), estimate.atVector(V(knot.index))
            knot.state = gtsam.NavState(pose, velocity)
            knot.bias = estimate.atConstantBias(B(knot.index))
        for link in filter(None, (interval.link for interval in self.intervals)):
            link.shift = estimate.atDouble(link.key)
        linearized = self._smoother.linearization_point()
        for line in self.lines.values():
            if estimate.exists(line.key):
                line.delta = estimate.atVector(line.key)
                line.linearized = linearized.atVector(line.key)

    def _check(self, estimate: gtsam.Values) -> bool:
        """Whether the newest state is close to the IMU's prediction; it must not be far off."""
        k, predicted = self.newest.index, self.newest.state
        place, velocity = estimate.atPose3(X(k)).translation(), estimate.atVector(V(k))
        jump = float(np.linalg.norm(place - predicted.position()))
        change = float(np.linalg.norm(velocity - predicted.velocity()))
        if not (jump < _JUMP and change < _VELOCITY_JUMP):
            raise SmootherError(f"the estimate jumped by {jump:.2g} m, {change:.2g} m/s")
        return jump < _STEP and change < _VELOCITY_STEP

    def _read_covariances(self) -> None:
        k = self.newest.index
        pose, velocity, bias = (self._smoother.covariance(key(k)) for key in (X, V, B))
        if pose is not None and velocity is not None and bias is not None:
            self.newest.covariances = pose, velocity, bias
        link = self.intervals[-1].link
        if link is not None:
            variance = self._smoother.covariance(link.key)
            if variance is not None:
                link.sigma = float(np.sqrt(variance[0, 0]))
            self.time_offset = link.offset
        # A line's covariance shrinks as it is seen: an old one errs on the safe side.
        stalest = sorted(self.lines.values(), key=lambda line: line.covariance_time)
        for line in stalest[:_COVARIANCES]:
            covariance = self._smoother.covariance(line.key)
            line.covariance_time = self.newest.time
            if covariance is not None:
                line.covariance = covariance

    def _judge(self) -> None:
        """Retire lines that do not fit their points or lie behind the camera."""
        interval = self.intervals[-1]
        of_frames = interval.cameras(self._body_T_cam)
        at_knot = interval.state(np.zeros(4))
        good, cameras, ends = [], [], []
        for line, factor, points, (place, last_points) in interval.observations:
            if factor.spec.keys[-1] != line.key or self.lines.get(line.track.number) is not line:
                continue  # it was just re-anchored, or dropped
            value = factor.evaluate(at_knot._replace(line=line.delta), False).value
            weight = points.weight
            off = math.sqrt(float(value @ value) / weight) * self._focal
            offset = points.mean_distance(value) * math.sqrt(weight) / self._deviation
            interval.offsets.append(offset)
            misses = off > _BAD_MISFIT
            interval.misfits += misses
            inverse, sigma = line.inverse_distance()
            bad = misses or inverse < -2.0 * sigma - 0.01
            line.bad_knots = line.bad_knots + 1 if bad else 0
            if line.bad_knots >= _BAD_KNOTS:
                line.track.give_up()
                del self.lines[line.track.number]
            elif not bad:
                good.append(line)
                cameras.append(of_frames[place])
                ends.append(last_points[[0, -1]])
        note_reach(good, cameras, np.array(ends))

    def _rebuild(self) -> None:
        """A new smoother from the window's own states, marginals and data; failing that, without
        its lines.
        """
        for with_lines in (True, False):
            if not with_lines:
                for line in self.lines.values():
                    line.track.give_up()
                self.lines.clear()
            try:
                self._smoother = self._fresh_smoother(careful=True)
                walk = self._config.time_offset.walk
                factors, values, times = known_of(
                    self.knots, self.intervals, self.lines.values(), walk
                )
                self._read(self._smoother.update(factors, values, times, self._check))
                self.lines = {n: line for n, line in self.lines.items() if line.key in times}
                return
            except SmootherError:
                continue
        self._broken = True
