# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What solves for a run: the factor graph, or the paper's own solver as a baseline."""

from typing import TYPE_CHECKING, Literal, TypeAlias

from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import Config
from ruledgraph.odometry import Odometry

if TYPE_CHECKING:  # its optimiser takes a third of a second to load
    from ruledgraph.baselines.paper import PaperOdometry

Solver: TypeAlias = Literal["graph", "paper"]
AnyOdometry: TypeAlias = "Odometry | PaperOdometry"


def odometry_for(solver: Solver, calibration: Calibration, config: Config) -> AnyOdometry:
    """The odometry that solves so; the paper's has no use for the `config`."""
    if solver == "graph":
        return Odometry(calibration, config)
    from ruledgraph.baselines.paper import PaperOdometry

    return PaperOdometry(calibration)
