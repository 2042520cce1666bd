# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The lines of the window: this is the one place that decides on the life of a line.

A line enters when its track is mature and can be triangulated, is observed interval by interval,
gets a new variable when its estimate has moved far from its linearisation point, is rejected when
it does not fit its points, and retires when it was last seen before the window.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence

import gtsam
import numpy as np

from ruledgraph.backend.graph_update import GraphUpdate
from ruledgraph.backend.landmarks import Landmark, record_extent
from ruledgraph.backend.line_distance import usual_distance
from ruledgraph.backend.line_factors import EdgeModel, observation
from ruledgraph.backend.line_fit import line_fit
from ruledgraph.backend.line_graph_builder import ImpossibleLineError, LineGraphBuilder
from ruledgraph.backend.line_weights import LineWeights
from ruledgraph.backend.rest_factors import rests_throughout
from ruledgraph.backend.start import Start
from ruledgraph.backend.states import Interval, LineObservation
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.line_observations import LineTrack


class LineManager:
    """Lines that enter the graph and leave it.

    Args:
        calibration: of the camera.
        config: all settings.
        start: with estimates of lines by the id of the track, and the noise of edges.
    """

    def __init__(self, calibration: Calibration, config: Config, start: Start) -> None:
        self.lines: dict[int, Landmark] = {}
        """By their ids."""
        self._retired: list[Landmark] = []
        self._rejected: set[int] = set()
        # Rejected lines whose factors are still in the graph: where most lines fit no longer, the
        # estimate may be wrong, and they bring it back.
        self._dropped: list[Landmark] = []
        self._config = config.lines
        self._min_track_age = config.tracks.min_track_age
        self.model = EdgeModel.of(calibration, config)
        """Of the camera and its edge points."""
        self.weights = LineWeights(self.model.sigma, start.edge_variance, config)
        self._builder = LineGraphBuilder(self.model, config.lines, start.lines)

    # -- entering --------------------------------------------------------------------------------

    def observe(
        self,
        tracks: Collection[LineTrack],
        intervals: Sequence[Interval],
        now: float,
        update: GraphUpdate,
        precomputed: Mapping[int, LineObservation],
    ) -> None:
        """Take in what was seen in the newest interval, which ends `now`, s.

        Observations may be there already, of `observations_in`. While the body rests, all the
        window long, no parallax shows how far away a new line is: it waits, unless there are none
        yet.
        """
        distance, newest = self.usual_distance(), intervals[-1]
        rests = rests_throughout(intervals)
        waits = rests and bool(self.lines)
        followed = {track.id for track in tracks}
        for known in self.lines.values():
            # Of a track that was another one's duplicate nothing more is seen.
            known.in_view = known.in_view and known.id in followed
        for track in tracks:
            line = self.lines.get(track.id)
            if line is not None:
                line.in_view = track.in_view
                seen, own = newest.sightings_of(track), precomputed.get(track.id)
                self._builder.observe(seen, line, now, update, rests, own)
            elif not waits and self._is_mature(track, now):
                try:
                    entered = self._builder.new_line(
                        track, intervals, now, update, rests, distance, self.weights.new_line_weight
                    )
                except ImpossibleLineError:
                    self._rejected.add(track.id)
                else:
                    if entered is not None:
                        self.lines[track.id] = entered

    def observations_in(
        self, interval: Interval, tracks: Iterable[LineTrack]
    ) -> dict[int, LineObservation]:
        """Of the lines of the graph, by their ids, in an interval that is not in the graph yet."""
        known = [track for track in tracks if track.id in self.lines]
        seen = {track.id: interval.sightings_of(track) for track in known}
        return {
            id_: observation(part, self.lines[id_], self.model)
            for id_, part in seen.items()
            if part.frames
        }

    def usual_distance(self) -> float:
        """That a new line is expected at, m."""
        known = [line.inverse_distance() for line in self.lines.values()]
        return usual_distance(
            known + self._builder.initial_distances(), self._config.prior_distance
        )

    def _is_mature(self, track: LineTrack, time: float) -> bool:
        is_old = time - track.first_time >= self._min_track_age
        return self._builder.has_initial_line(track.id) or (is_old and track.in_view)

    # -- staying ---------------------------------------------------------------------------------

    def update_variables(self, intervals: Sequence[Interval], update: GraphUpdate) -> bool:
        """Remove the factors of rejected lines that turn round, whose charts end in a singularity;
        give lines a new variable whose estimates moved far from their linearisation point.

        Returns:
            Whether there were any.
        """
        turned = [line for line in self._dropped if line.chart.is_far(line.delta)]
        for line in turned:
            self._builder.remove(line, update)
            self._dropped.remove(line)
        far = [
            line
            for line in self.lines.values()
            if line.linearization_frozen
            and np.abs(line.delta - line.linearized).max() > self._config.recentre_change
        ]
        for line in far:
            self._builder.recentre(line, intervals, update)
        return bool(turned or far)

    def read(self, estimate: gtsam.Values, linearization_point: gtsam.Values) -> None:
        """Take over what the smoother found."""
        for line in (*self.lines.values(), *self._dropped):
            if estimate.exists(line.key):
                line.delta = estimate.atVector(line.key)
                line.linearized = linearization_point.atVector(line.key)

    # -- leaving ---------------------------------------------------------------------------------

    def check_fit(self, interval: Interval) -> None:
        """Reject lines that do not fit their points in the newest interval, lie behind the camera,
        or are a quarter of a turn from where they were placed first.
        """
        of_frames = interval.cameras(self.model.body_T_cam)
        state = interval.state(np.zeros(4))
        good, cameras, ends = [], [], []
        for seen in interval.observations:
            line, (frame, last_points) = seen.line, seen.last
            if self.lines.get(line.id) is not line:
                continue  # it was dropped
            fit = line_fit(seen, state, self.model, self._config)
            interval.compared += 1
            interval.misfits += fit.is_misfit
            bad = fit.is_misfit or fit.is_behind
            line.bad_states = line.bad_states + 1 if bad else 0
            if line.bad_states >= self._config.max_bad_states:
                self._reject(line)
            elif not bad:
                good.append(line)
                cameras.append(of_frames[frame])
                ends.append(last_points[[0, -1]] / interval.focal_ratio)
        record_extent(good, cameras, np.array(ends))
        for line in [line for line in self.lines.values() if line.chart.is_far(line.delta)]:
            self._reject(line)

    def _reject(self, line: Landmark) -> None:
        self._rejected.add(line.id)
        self._dropped.append(self.lines.pop(line.id))

    def retire(self, before: float) -> None:
        """Lines that were last seen before a time (s) leave."""
        for id_ in [id_ for id_, line in self.lines.items() if line.last_time < before]:
            self._retired.append(self.lines.pop(id_))
        self._dropped = [line for line in self._dropped if line.last_time >= before]

    def reject_all(self) -> None:
        """Go on without lines."""
        self._rejected |= self.lines.keys()
        self.lines.clear()
        self._dropped.clear()

    def keep_only(self, keys: Iterable[int]) -> None:
        """Keep the lines with these variables alone."""
        kept = set(keys)
        self.lines = {id_: line for id_, line in self.lines.items() if line.key in kept}
        self._dropped = [line for line in self._dropped if line.key in kept]

    def take_retired(self) -> list[Landmark]:
        """Lines that left since the last call."""
        taken, self._retired = self._retired, []
        return taken

    def take_rejected(self) -> set[int]:
        """Ids of the lines rejected since the last call, whose tracks are to be dropped."""
        taken, self._rejected = self._rejected, set()
        return taken
