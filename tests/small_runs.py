# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Runs of the odometry over measurements, and how far off its trajectory is."""

from collections.abc import Sequence

import numpy as np
from click.testing import CliRunner, Result

from ruledgraph.app.cli import main
from ruledgraph.core.config import DEFAULTS, Config
from ruledgraph.core.estimates import Estimate
from ruledgraph.evaluation import alignment
from ruledgraph.odometry import Odometry


def smooth(*arguments: object) -> Result:
    """`ruledgraph smooth` with these arguments."""
    return CliRunner().invoke(main, ["smooth", *map(str, arguments)])


def run(
    measurements, calibration, config: Config = DEFAULTS
) -> tuple[Odometry, list[Estimate], list[Estimate]]:
    odometry = Odometry(calibration, config)
    live, smoothed = [], []
    for measurement in measurements:
        odometry.add(measurement)
        live += odometry.take_live()
        smoothed += odometry.take_smoothed()
    odometry.finish()
    live += odometry.take_live()
    smoothed += odometry.take_smoothed()
    return odometry, live, smoothed


def ate(estimates: list[Estimate], simulation) -> float:
    """RMSE of the aligned positions, m."""
    true = simulation.truth(np.array([e.stamp for e in estimates])).position
    own = np.array([e.world_T_body.translation() for e in estimates])
    A = alignment(own, true)
    return float(np.sqrt(np.mean(np.sum((own @ A[:3, :3].T + A[:3, 3] - true) ** 2, axis=1))))


def ever_degraded(live: Sequence[Estimate]) -> bool:
    """Whether an estimate is, from half a second after the first: until then, the biases being
    unknown, the velocity is not known to the limit of `tracking`.
    """
    return any(e.status == "degraded" for e in live if e.stamp > live[0].stamp + 500_000_000)
