# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How well lines fit their points in the newest interval."""

import math
from typing import NamedTuple

from ruledgraph.backend.line_factors import EdgeModel
from ruledgraph.backend.states import LineObservation
from ruledgraph.core.config import LinesConfig
from ruledgraph_factors.ruled_surface import State

# So little behind the camera, 1/m, a line is as good as at infinity.
_AT_INFINITY = 0.01


class LineFit(NamedTuple):
    """Of a line in an interval."""

    is_misfit: bool
    """Whether it does not fit its points."""
    is_behind: bool
    """Whether it lies behind the camera."""


def line_fit(seen: LineObservation, state: State, model: EdgeModel, config: LinesConfig) -> LineFit:
    """Compare a line with its points.

    Args:
        seen: the line in an interval.
        state: the interval's state.
        model: of the camera and its edge points.
        config: limits.
    """
    line = seen.line
    value = seen.factor.evaluate(state._replace(line=line.delta), False).value
    rms_px = math.sqrt(float(value @ value) / seen.points.weight) * model.focal
    inverse, sigma = line.inverse_distance()
    return LineFit(
        is_misfit=rms_px > config.max_misfit_px,
        is_behind=inverse < -config.behind_sigmas * sigma - _AT_INFINITY,
    )
