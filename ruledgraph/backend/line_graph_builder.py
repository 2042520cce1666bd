# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Variables and factors of lines: of new ones, of observed ones, and of those that moved far."""

from collections.abc import Mapping, Sequence

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import L

from ruledgraph.backend.graph_update import GraphUpdate
from ruledgraph.backend.landmarks import Landmark
from ruledgraph.backend.line_distance import InverseDistance
from ruledgraph.backend.line_factors import (
    EdgeModel,
    compressed_points,
    new_line_factors,
    observation,
    on_variable,
)
from ruledgraph.backend.start import InitialLine
from ruledgraph.backend.states import Interval, IntervalSightings, LineObservation
from ruledgraph.core.config import LinesConfig
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.line_observations import LineTrack
from ruledgraph_factors import (
    NEW_LINE_SIGMAS,
    FactorError,
    same_line_factor,
    triangulate_line,
)

# rad; less than half of 0.1 px at a focal length of 400 px. A tighter factor is ill-conditioned.
_MIN_RECENTRE_SIGMA = 1e-4


class ImpossibleLineError(RuledgraphError):
    """A track's points put its line behind the camera or too close to it."""


class LineGraphBuilder:
    """Gives lines their variables and factors.

    Args:
        model: of the camera and its edge points.
        config: of lines.
        initial_lines: estimates of a start, by the id of the track.
    """

    def __init__(
        self,
        model: EdgeModel,
        config: LinesConfig,
        initial_lines: Mapping[int, InitialLine],
    ) -> None:
        self._model = model
        self._config = config
        self._initial_lines = dict(initial_lines)
        self._keys_so_far = 0

    def initial_distances(self) -> list[InverseDistance]:
        """Of the lines that a start has estimated and that have not entered yet."""
        return [line.inverse_distance() for line in self._initial_lines.values()]

    def has_initial_line(self, id_: int) -> bool:
        """Whether a start has estimated the line of a track."""
        return id_ in self._initial_lines

    def observe(
        self,
        seen: IntervalSightings,
        line: Landmark,
        now: float,
        update: GraphUpdate,
        rests: bool,
        precomputed: LineObservation | None = None,
    ) -> None:
        """Add the factor of a line over the frames of an interval that saw it and that ends `now`,
        s.

        While the body rests, all the window long, a line gets one only: later images repeat its
        errors, and counted again and again these move the estimate. The observation may be there
        already, of `LineManager.observations_in`.
        """
        interval, index, sightings = seen
        if not index:
            return
        own = precomputed or observation(seen, line, self._model)
        interval.observations.append(own)
        own.in_graph = not (rests and line.points)
        if own.in_graph:
            update.factors.add(own.factor)
        line.points += sum(len(sighting.points) for sighting in sightings)
        line.last_stamp = max(line.last_stamp, interval.stamps[index[-1]])
        line.last_time = update.times[line.key] = now

    def new_line(
        self,
        track: LineTrack,
        intervals: Sequence[Interval],
        now: float,
        update: GraphUpdate,
        rests: bool,
        distance: float,
        weight: float,
    ) -> Landmark | None:
        """Give a track a variable, with factors in all intervals that saw it.

        `distance` (m) is the `usual_distance` of lines, `weight` the usual one.

        Returns:
            The line; None if it cannot be triangulated yet.

        Raises:
            ImpossibleLineError: if they place it behind the camera or too close to it.
        """
        seen = [interval.sightings_of(track) for interval in intervals]
        seen = [part for part in seen if part.frames]
        if not seen:
            return None
        initial = self._initial_lines.pop(track.id, None) or self._triangulated(seen)
        if initial is None:
            return None
        self._check(initial)
        first = seen[0]
        line = Landmark(
            id=track.id,
            key=L(self._keys_so_far),
            chart=initial.chart,
            delta=np.zeros(4),
            in_view=track.in_view,
            covariance=initial.covariance,
            first_stamp=first.interval.stamps[first.frames[0]],
            last_stamp=0,
            last_time=now,
            weight=weight,
        )
        self._keys_so_far += 1
        update.values.insert(line.key, line.delta)
        for part in seen:
            self.observe(part, line, now, update, rests)
        for factor in new_line_factors(first.interval.node, line, self._config, distance):
            update.factors.add(factor)
        return line

    def _triangulated(self, seen: Sequence[IntervalSightings]) -> InitialLine | None:
        if sum(len(part.frames) for part in seen) < self._config.min_sightings:
            return None
        cameras: list[gtsam.Pose3] = []
        for interval, index, _ in seen:
            of_frames = interval.cameras(self._model.body_T_cam)
            cameras += [of_frames[i] for i in index]
        points = compressed_points([sighting for part in seen for sighting in part.sightings])
        points = points.with_focal_ratio(seen[-1].interval.focal_ratio)
        try:
            fit = triangulate_line(cameras, points, self._model.sigma)
        except FactorError:
            return None
        if fit.rms * self._model.focal > self._config.max_new_misfit_px:
            return None
        return InitialLine(fit.chart, fit.covariance)

    def _check(self, initial: InitialLine) -> None:
        inverse, sigma = initial.inverse_distance()
        behind = inverse < -self._config.behind_sigmas * sigma
        if behind or abs(inverse) > 1.0 / self._config.min_distance:
            raise ImpossibleLineError(f"one over its distance is {inverse:.2g} 1/m")

    def remove(self, line: Landmark, update: GraphUpdate) -> None:
        """Remove the factors of a line; its variable stays until its time, with a prior of its
        own.
        """
        update.removal.variables.add(line.key)
        wide = noiseModel.Diagonal.Sigmas(np.array(NEW_LINE_SIGMAS))
        update.factors.addPriorVector(line.key, line.delta, wide)

    def recentre(self, line: Landmark, intervals: Sequence[Interval], update: GraphUpdate) -> None:
        """A new chart about the current estimate, under a new key, with the line's factors in these
        intervals and one to the old variable, which has what was marginalised.

        The smoother does not relinearise a variable whose neighbour has left the window. A line
        without parallax until then would stay linearised at an arbitrary depth, and so would all
        images of it.
        """
        # The marginal on the old variable is linear: what it says of the line is off by the second
        # term of Taylor's series in how far the line has moved since. (How far it moves on, when
        # the state is solved again, is not in it.)
        moved = line.delta - line.linearized
        sigma = max(0.5 * float(moved @ moved), _MIN_RECENTRE_SIGMA)
        noise = noiseModel.Isotropic.Sigma(4, sigma)
        old_key, key = line.key, L(self._keys_so_far)
        chart, by_delta = line.chart.recentred(line.delta)
        self._keys_so_far += 1
        update.factors.add(same_line_factor(noise, old_key, key, line.chart, line.delta, chart))
        update.values.insert(key, np.zeros(4))
        update.times |= {old_key: line.last_time, key: line.last_time}
        line.covariance = by_delta @ line.covariance @ by_delta.T + sigma**2 * np.eye(4)
        line.key, line.chart, line.delta = key, chart, np.zeros(4)
        seen = [own for part in intervals for own in part.observations if own.line is line]
        update.remove([own.factor for own in seen if own.in_graph])
        for own in seen:
            own.factor = on_variable(own.factor, line)
            if own.in_graph:
                update.factors.add(own.factor)
        line.linearized, line.linearization_frozen = line.delta, False
