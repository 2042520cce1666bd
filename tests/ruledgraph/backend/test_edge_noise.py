# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The noise of edge points, by residuals."""

import numpy as np
import pytest

from ruledgraph.backend.edge_noise import edge_variance
from ruledgraph.core.config import EdgesConfig


@pytest.mark.parametrize("count", [4, 40])
def test_the_figure_and_residuals_count_by_their_degrees_of_freedom(count):
    """Noise whose variance is drawn from the prior: as much information as there is on average."""
    rng = np.random.default_rng(0)
    draws, config = 20_000, EdgesConfig(variance_prior=8.0, correlation=1.0)
    true = 8.0 / rng.chisquare(8.0, size=draws)
    squares = true * rng.chisquare(count, size=draws)
    told = 1.0 / np.array([edge_variance(one, count, config) for one in squares.tolist()])
    # One has a deviation of 0.5 or less, the mean of 20,000 of 0.0035.
    assert np.mean(told) == pytest.approx(1.0, abs=0.012)
    # And where it is larger, so is the information by the same.
    assert np.polyfit(told, 1.0 / true, 1)[0] == pytest.approx(1.0, abs=0.05)


def test_errors_that_last_eight_frames_count_for_an_eighth():
    rng = np.random.default_rng(1)
    errors = np.repeat(2.0 * rng.standard_normal(5000), 8)
    variance = edge_variance(float(errors @ errors), len(errors), EdgesConfig(correlation=8.0))
    # The mean of all errors deviates as that of independent ones of this variance; the sample's is
    # good to 2 %.
    assert variance / len(errors) == pytest.approx(2.0**2 / 5000, rel=0.06)


@pytest.mark.parametrize("dof", [0.0, -3.0])
def test_without_degrees_of_freedom_the_figure_stands(dof):
    assert edge_variance(7.0, dof, EdgesConfig()) == 1.0
