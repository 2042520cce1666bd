# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Is what an optimiser returned the minimum it should be? Line by line."""

import math
from dataclasses import dataclass

import gtsam
import numpy as np

from ruledgraph_factors.factor import state_at
from ruledgraph_factors.factor_spec import spec_of
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.noise import whitened_square
from ruledgraph_factors.ruled_surface import Geometry
from ruledgraph_factors.spec import RuledSurfaceSpec
from ruledgraph_factors.validation import FloatArray

# Quantile of the standard normal distribution: 99.9 %.
_QUANTILE = 3.09
# Of the numbers of a chart, m or rad, that was computed twice.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class LineCheck:
    """One line of a graph at an estimate, by all its factors."""

    key: int
    chi_squared: float
    """Sum of the whitened squared distances of all its points, robust losses left out."""
    expected: float
    """The expectation of `chi_squared` at the right minimum: what its points weigh together, or two
    a frame where they are `without_scatter`."""
    limit: float
    """The 99.9 % quantile of the chi-squared distribution of so many degrees of freedom."""
    behind: float
    """Share of its frames whose camera has the line behind it, at the middle of the points."""
    far: bool
    """Whether its delta is far from the chart's reference: `LineChart.is_far`."""
    mixed_charts: bool = False
    """Whether its factors, priors included, have different charts. They must have the same one: its
    delta, and so all other figures here, mean nothing."""

    @property
    def misfit(self) -> bool:
        """Whether the points contradict the line: a wrong minimum, wrong points, or wrong noise."""
        return self.chi_squared > self.limit

    @property
    def undefined(self) -> bool:
        """Whether there is NaN in its delta, or in another variable of its factors."""
        return math.isnan(self.chi_squared)

    @property
    def ok(self) -> bool:
        """Nothing speaks against the line."""
        return not self.reasons

    @property
    def reasons(self) -> list[str]:
        """What speaks against the line."""
        cases = (
            ("its factors have different charts", self.mixed_charts),
            ("NaN in it or in another variable of its factors", self.undefined),
            ("its points contradict it", self.misfit),
            ("behind the cameras", self.behind > 0.5),
            ("far from its chart's reference", self.far),
        )
        return [text for text, applies in cases if applies]

    def __str__(self) -> str:
        """One line of text, with the reasons if it is not ok."""
        name = gtsam.DefaultKeyFormatter(self.key)
        fit = f"{name}: chi-squared {self.chi_squared:.0f}, expected {self.expected:.0f}"
        return f"{fit} (at most {self.limit:.0f}): {', '.join(self.reasons) or 'ok'}"


def check_lines(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> list[LineCheck]:
    """All lines of a graph at an estimate: which of them ended in a wrong minimum?

    At the right minimum sum |r|^2 of a line, r the whitened residuals of its point-to-ruled-surface
    factors, is about the number of its points (two a frame without their scatter). A line with a
    wrong distance or direction that the optimiser could not leave shows there, behind its cameras,
    or far from its chart's reference; so does one whose factors do not all have one chart, or with
    NaN.
    Give a line in a wrong minimum a new start (`triangulate_line` with the estimated poses) under a
    new key.

    Args:
        graph: may hold any factors; only lines with ruled-surface factors of ours count.
        values: an estimate of all its variables.

    Returns:
        One check for each line key, in order of the keys.
    """
    sums: dict[int, FloatArray] = {}  # of chi_squared, expected, frames, frames behind
    charts: dict[int, LineChart] = {}
    mixed: set[int] = set()
    for index in range(graph.size()):
        factor = graph.at(index) if graph.exists(index) else None
        if not isinstance(factor, gtsam.NoiseModelFactor):
            continue
        spec = spec_of(factor)
        for key, chart in (spec.charts if spec else {}).items():
            if not _same_chart(charts.setdefault(key, chart), chart):
                mixed.add(key)
        if not isinstance(spec, RuledSurfaceSpec):
            continue
        square = whitened_square(spec.noise_model, factor.unwhitenedError(values))
        behind = _frames_behind(spec, values)
        row = np.array([square, spec.points.degrees_of_freedom, len(spec.motion), behind])
        sums[spec.line_key] = sums.get(spec.line_key, np.zeros(4)) + row
    return [_line_check(key, sums[key], values, key in mixed) for key in sorted(sums)]


def _same_chart(one: LineChart, other: LineChart) -> bool:
    """But for rounding."""
    return one is other or (
        one.world_T_anchor.equals(other.world_T_anchor, _ROUNDING)
        and bool(np.allclose(one.basis, other.basis, rtol=0.0, atol=_ROUNDING))
        and abs(one.angle - other.angle) <= _ROUNDING
    )


def _line_check(key: int, sums: FloatArray, values: gtsam.Values, mixed_charts: bool) -> LineCheck:
    square, expected, frames, behind = sums.tolist()
    far = LineChart.is_far(values.atVector(key))
    # Wilson and Hilferty's approximation of the quantile.
    third = 2.0 / (9.0 * expected)
    limit = expected * (1.0 - third + _QUANTILE * np.sqrt(third)) ** 3
    return LineCheck(key, square, expected, float(limit), behind / frames, far, mixed_charts)


def _frames_behind(spec: RuledSurfaceSpec, values: gtsam.Values) -> int:
    """How many frames have the line behind their camera at the middle of the points."""
    keys = list(spec.keys)
    state = state_at(spec, keys, values)
    body_T_cam = spec.body_T_cam if state.body_T_cam is None else gtsam.Pose3(state.body_T_cam)
    line = Geometry(spec.chart, spec.motion, body_T_cam).line_in_cameras(state, False)
    ratio = 1.0 if state.focal_ratio is None else state.focal_ratio
    rays = np.column_stack([spec.points.middles(), np.full(len(spec.motion), ratio)])
    # x = depth ray, x cross v = m: the depth has the sign of (ray cross v) . m
    depths = line.sign * np.sum(np.cross(rays, line.direction) * line.moment, axis=1)
    return int(np.sum(depths < 0.0))
