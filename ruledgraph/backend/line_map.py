# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The lines of the window: this is the one place that decides on the life of a line.

A line is born when its track is mature and can be triangulated, is observed interval by interval,
gets a new variable when it has moved far from where the smoother holds it, is rejected when it does
not fit its points, and retires when it was last seen before the window.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import L

from ruledgraph.backend.fixed_lag_smoother import FixedLagSmoother
from ruledgraph.backend.graph_update import GraphUpdate
from ruledgraph.backend.landmarks import Landmark, record_extent
from ruledgraph.backend.line_factors import compressed_points, new_line_factors, observation
from ruledgraph.backend.states import Interval
from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph.core.line_observations import LineTrack, Sighting
from ruledgraph_factors import FactorError, LineChart, same_line_factor, triangulate_line

# So little behind the camera, 1/m, a line is as good as at infinity.
_AT_INFINITY = 0.01


class LineMap:
    """Lines that enter the graph and leave it.

    Args:
        calibration: of the camera.
        config: all settings.
        known: of tracks by number, what a start found of them.
    """

    def __init__(
        self,
        calibration: Calibration,
        config: Config,
        known: Mapping[int, tuple[LineChart, FloatArray]],
    ) -> None:
        self.lines: dict[int, Landmark] = {}
        """By their ids."""
        self.retired: list[Landmark] = []
        """Lines that left, until someone takes them."""
        self.rejected: set[int] = set()
        """Ids of lines whose tracks are no use, until someone takes them."""
        self._body_T_cam = calibration.body_T_cam
        self._config = config.lines
        self._min_track_age = config.tracks.min_track_age
        self._focal = calibration.camera.focal_length
        self._sigma = config.edges.sigma_px / self._focal
        self._cauchy_scale = config.lines.cauchy_scale_px / self._focal
        self._known = dict(known)
        self._keys_so_far = 0

    # -- entering --------------------------------------------------------------------------------

    def observe(
        self,
        tracks: Iterable[LineTrack],
        intervals: Sequence[Interval],
        now: float,
        update: GraphUpdate,
    ) -> None:
        """Take in what was seen in the newest interval, which ends `now`, s."""
        for track in tracks:
            line = self.lines.get(track.id)
            if line is not None:
                line.in_view = track.in_view
                seen = intervals[-1].seen(track.sightings)
                self._observe(intervals[-1], line, *seen, now, update)
            elif self._is_mature(track, now):
                self._enter(track, intervals, now, update)

    def _is_mature(self, track: LineTrack, time: float) -> bool:
        followed = time - track.first_time >= self._min_track_age
        return track.id in self._known or (followed and track.in_view)

    def _observe(
        self,
        interval: Interval,
        line: Landmark,
        index: Sequence[int],
        sightings: Sequence[Sighting],
        now: float,
        update: GraphUpdate,
    ) -> None:
        """The factor of a line over the frames of an interval that saw it."""
        if not index:
            return
        seen = observation(
            interval, line, index, sightings, self._body_T_cam, self._sigma, self._cauchy_scale
        )
        interval.observations.append(seen)
        update.factors.add(seen.factor)
        line.points += sum(len(sighting.points) for sighting in sightings)
        line.last_stamp = max(line.last_stamp, interval.stamps[index[-1]])
        line.last_time = update.times[line.key] = now

    def _enter(
        self, track: LineTrack, intervals: Sequence[Interval], now: float, update: GraphUpdate
    ) -> None:
        """Give a track a variable, with factors in all intervals that saw it."""
        seen = [(interval, *interval.seen(track.sightings)) for interval in intervals]
        seen = [s for s in seen if s[1]]
        if not seen:
            return
        known = self._known.pop(track.id, None) or self._triangulated(track, seen)
        if known is None:
            return
        chart, delta = known
        unseen, in_plane = self._config.new_unseen_variance, self._config.new_seen_variance
        line = Landmark(
            id=track.id,
            key=self._new_key(),
            chart=chart,
            delta=delta,
            in_view=track.in_view,
            linearized=delta,
            covariance=np.diag(np.repeat([unseen, in_plane], 2)),
            first_stamp=seen[0][0].stamps[seen[0][1][0]],
            last_stamp=0,
            last_time=now,
        )
        self.lines[track.id] = line
        update.values.insert(line.key, delta)
        for interval, index, sightings in seen:
            self._observe(interval, line, index, sightings, now, update)
        for factor in new_line_factors(seen[0][0].node, seen[0][0].observations[-1], self._config):
            update.factors.add(factor)

    def _triangulated(
        self, track: LineTrack, seen: Sequence[tuple[Interval, list[int], list[Sighting]]]
    ) -> tuple[LineChart, FloatArray] | None:
        if sum(len(index) for _, index, _ in seen) < self._config.min_sightings:
            return None
        cameras: list[gtsam.Pose3] = []
        for interval, index, _ in seen:
            of_frames = interval.cameras(self._body_T_cam)
            cameras += [of_frames[i] for i in index]
        sightings = [sighting for _, _, part in seen for sighting in part]
        points = compressed_points(sightings)
        try:
            fit = triangulate_line(cameras, points, self._sigma)
        except FactorError:
            return None
        if fit.rms * self._focal > self._config.max_new_misfit_px:
            return None
        inverse, slope = fit.chart.inverse_distance(np.zeros(4))
        sigma = math.sqrt(float(slope @ fit.covariance @ slope))
        behind = inverse < -self._config.behind_sigmas * sigma
        if behind or inverse > 1.0 / self._config.min_distance:
            self.rejected.add(track.id)
            return None
        return fit.chart, np.zeros(4)

    def _new_key(self) -> int:
        self._keys_so_far += 1
        return L(self._keys_so_far - 1)

    # -- staying ---------------------------------------------------------------------------------

    def reanchor(self, update: GraphUpdate) -> None:
        """Give lines a new variable that have moved far from where the smoother holds them."""
        for line in self.lines.values():
            if (
                line.fixed
                and np.abs(line.delta - line.linearized).max() > self._config.reanchor_change
            ):
                self._reanchor(line, update)

    def _reanchor(self, line: Landmark, update: GraphUpdate) -> None:
        """A new chart at the current estimate, under a new key that is tied to the old one.

        The smoother never linearises a variable anew whose neighbour has left the window. A line
        that was not seen from two places by then would keep a depth of which nothing was known.
        """
        # The marginal that fixed the old variable knows it where it was linearised. Here, as far
        # from there as it has moved, what it leaves open (place and heading) looks a little
        # different: a tie closer than that would make it known, and tear at it.
        moved = float(np.abs(line.delta - line.linearized).max())
        noise = noiseModel.Isotropic.Sigma(4, moved)
        old_key, key, anchor = line.key, L(self._keys_so_far), line.chart.world_T_anchor
        try:
            chart, by_delta = line.chart.reanchor(line.delta, anchor)
            factor = same_line_factor(noise, old_key, key, line.chart, line.delta, chart)
        except FactorError:
            return  # through its anchor: it will be judged
        self._keys_so_far += 1
        update.factors.add(factor)
        update.values.insert(key, np.zeros(4))
        update.times |= {old_key: line.last_time, key: line.last_time}
        line.covariance = by_delta @ line.covariance @ by_delta.T
        line.key, line.chart, line.delta = key, chart, np.zeros(4)
        line.linearized, line.fixed = line.delta, False

    def read(self, estimate: gtsam.Values, linearization_point: gtsam.Values) -> None:
        """Take over what the smoother found."""
        for line in self.lines.values():
            if estimate.exists(line.key):
                line.delta = estimate.atVector(line.key)
                line.linearized = linearization_point.atVector(line.key)

    def read_covariances(self, smoother: FixedLagSmoother, now: float) -> None:
        """Of the lines whose covariance is the oldest: it shrinks as a line is seen, so that an
        old one errs on the safe side.
        """
        stalest = sorted(self.lines.values(), key=lambda line: line.covariance_time)
        for line in stalest[: self._config.covariances_per_state]:
            covariance = smoother.covariance(line.key)
            line.covariance_time = now
            if covariance is not None:
                line.covariance = covariance

    # -- leaving ---------------------------------------------------------------------------------

    def judge(self, interval: Interval) -> None:
        """Reject lines that do not fit their points in the newest interval, or lie behind the
        camera.
        """
        of_frames = interval.cameras(self._body_T_cam)
        at_node = interval.state(np.zeros(4))
        good, cameras, ends = [], [], []
        for line, factor, points, (frame, last_points) in interval.observations:
            if factor.spec.keys[-1] != line.key or self.lines.get(line.id) is not line:
                continue  # it was just re-anchored, or dropped
            value = factor.evaluate(at_node._replace(line=line.delta), False).value
            weight = points.weight
            off = math.sqrt(float(value @ value) / weight) * self._focal
            offset = points.mean_distance(value) * math.sqrt(weight) / self._sigma
            interval.offsets.append(offset)
            misses = off > self._config.max_misfit_px
            interval.misfits += misses
            inverse, sigma = line.inverse_distance()
            bad = misses or inverse < -self._config.behind_sigmas * sigma - _AT_INFINITY
            line.bad_nodes = line.bad_nodes + 1 if bad else 0
            if line.bad_nodes >= self._config.max_bad_states:
                self.rejected.add(line.id)
                del self.lines[line.id]
            elif not bad:
                good.append(line)
                cameras.append(of_frames[frame])
                ends.append(last_points[[0, -1]])
        record_extent(good, cameras, np.array(ends))

    def retire(self, before: float) -> None:
        """Lines that were last seen before a time (s) leave."""
        for id_ in [id_ for id_, line in self.lines.items() if line.last_time < before]:
            self.retired.append(self.lines.pop(id_))

    def reject_all(self) -> None:
        """Go on without lines."""
        self.rejected |= self.lines.keys()
        self.lines.clear()

    def keep(self, keys: Iterable[int]) -> None:
        """Keep the lines with these variables alone."""
        kept = set(keys)
        self.lines = {id_: line for id_, line in self.lines.items() if line.key in kept}

    def take_retired(self) -> list[Landmark]:
        """Lines that left since the last call."""
        taken, self.retired = self.retired, []
        return taken

    def take_rejected(self) -> set[int]:
        """Ids of the lines rejected since the last call."""
        taken, self.rejected = self.rejected, set()
        return taken
