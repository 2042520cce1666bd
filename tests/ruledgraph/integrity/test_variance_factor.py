# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The factor of all variances by the innovations."""

import numpy as np
import pytest

from ruledgraph.core.config import IntegrityConfig
from ruledgraph.core.estimates import Innovation
from ruledgraph.integrity.variance_factor import VarianceFactor

CONFIG = IntegrityConfig(variance_prior=5.0, variance_memory=5.0)


def test_without_innovations_the_noise_figures_hold():
    factor = VarianceFactor(CONFIG, window=2.5)
    assert [factor.update(None, 0.2) for _ in range(3)] == [1.0] * 3


def test_a_window_counts_as_the_degrees_of_freedom_of_one_innovation():
    """One at its end, or one at each of its states."""
    memory = IntegrityConfig(variance_prior=5.0, variance_memory=1e4)
    once, often = (VarianceFactor(memory, window=2.5) for _ in range(2))
    expected = (5.0 + 40.0) / (5.0 + 10.0)
    assert once.update(Innovation(40.0, 10), 2.5) == pytest.approx(expected, rel=1e-3)
    for _ in range(10):
        found = often.update(Innovation(40.0, 10), 0.25)
    assert found == pytest.approx(expected, rel=1e-3)


def test_what_was_told_is_forgotten():
    factor = VarianceFactor(CONFIG, window=2.5)
    factor.update(Innovation(100.0, 10), 2.5)
    kept = np.exp(-5.0 / 5.0)
    expected = (5.0 + 100.0 * kept) / (5.0 + 10.0 * kept)
    assert factor.update(None, 5.0) == pytest.approx(expected)
    assert factor.update(None, 1e3) == pytest.approx(1.0)


@pytest.mark.parametrize("true", [0.5, 4.0])
def test_it_finds_the_factor_of_its_draws(true):
    """On the way to it from 1 by the prior, (5 + 20.5 s^2) / 25.5 with 0.2 s of 2.5 a state."""
    rng = np.random.default_rng(0)
    factor = VarianceFactor(CONFIG, window=2.5)
    draws = true * rng.chisquare(10, size=5000)
    found = [factor.update(Innovation(nis, 10), 0.2) for nis in draws.tolist()]
    counted = 10 * 0.2 / 2.5 / (1.0 - np.exp(-0.2 / 5.0))
    expected = (5.0 + counted * true) / (5.0 + counted)
    # The mean over 200 memories, each of some 25 states: 0.6 % of deviation.
    assert np.mean(found[100:]) == pytest.approx(expected, rel=0.03)
