# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The factor of all variances by the innovations."""

import numpy as np
import pytest
from scipy.stats import chi2, norm, t

from ruledgraph.core.config import IntegrityConfig
from ruledgraph.core.estimates import Innovation
from ruledgraph.integrity.variance_factor import VarianceFactor

CONFIG = IntegrityConfig(variance_prior=5.0, variance_memory=5.0)


def told(nis: float, dof: int, time: float) -> Innovation:
    """Of a state at a time (s), against a prediction that began 2.5 s before."""
    return Innovation(nis, dof, time - 2.5)


def after(factor: VarianceFactor, innovation: Innovation | None, time: float) -> float:
    factor.update(innovation, time)
    return factor.of_covariances


def tails(degrees: float) -> float:
    """(t / 3)^2 with the three sigma of a Gaussian in probability."""
    return float((t.ppf(norm.cdf(3.0), degrees) / 3.0) ** 2)


def test_without_innovations_it_has_the_bounds_of_students_t():
    factor = VarianceFactor(CONFIG)
    found = [after(factor, None, time) for time in (0.2, 0.4, 0.6)]
    assert found == pytest.approx([tails(5.0)] * 3)


def test_the_newest_window_counts_in_full_and_is_not_counted_twice():
    factor = VarianceFactor(CONFIG)
    for time in np.arange(0.2, 2.4, 0.2).tolist():
        factor.update(told(40.0, 10, time), time)
        assert factor.estimate == pytest.approx((5.0 + 40.0) / (5.0 + 10.0))
        assert factor.of_covariances == pytest.approx(3.0 * tails(15.0))


def test_windows_that_do_not_overlap_count_the_older_the_less():
    factor = VarianceFactor(CONFIG)
    factor.update(told(100.0, 10, 1.0), 1.0)
    factor.update(told(7.0, 9, 2.0), 2.0)
    kept = np.exp(-2.5 / 5.0)
    degrees = 5.0 + 8.0 + 10.0 * kept
    expected = (5.0 + 30.0 + 100.0 * kept) / degrees * tails(degrees)
    assert after(factor, told(30.0, 8, 3.5), 3.5) == pytest.approx(expected)


def test_what_was_told_is_forgotten():
    factor = VarianceFactor(CONFIG)
    factor.update(told(100.0, 10, 1.0), 1.0)
    kept = np.exp(-5.0 / 5.0)
    degrees = 5.0 + 10.0 * kept
    expected = (5.0 + 100.0 * kept) / degrees * tails(degrees)
    assert after(factor, None, 6.0) == pytest.approx(expected)
    assert after(factor, None, 1e4) == pytest.approx(tails(5.0))


def test_what_was_predicted_on_trial_counts_while_it_is_the_newest():
    factor = VarianceFactor(CONFIG, counts_from=np.inf)
    assert after(factor, told(100.0, 10, 1.0), 1.0) == pytest.approx(7.0 * tails(15.0))
    factor.counts_from = 0.0
    assert after(factor, told(40.0, 10, 2.4), 2.4) == pytest.approx(3.0 * tails(15.0))
    assert after(factor, told(10.0, 10, 3.5), 3.5) == pytest.approx(tails(15.0))
    # That from then on counts on, and no other one does where none is the newest.
    degrees = 5.0 + 10.0 + 10.0 * np.exp(-2.5 / 5.0)
    assert after(factor, told(10.0, 10, 6.0), 6.0) == pytest.approx(tails(degrees))
    factor = VarianceFactor(CONFIG, counts_from=np.inf)
    factor.update(told(100.0, 10, 1.0), 1.0)
    assert after(factor, None, 1.2) == pytest.approx(tails(5.0))


@pytest.mark.parametrize("dof", [3, 10])
def test_errors_in_units_of_it_are_as_large_as_it_says(dof):
    """Noise whose factor is drawn from its prior, one window of innovations, and one error."""
    rng = np.random.default_rng(0)
    count, prior = 20_000, 8.0
    true = prior / rng.chisquare(prior, size=count)
    nis = true * rng.chisquare(dof, size=count)
    errors = np.sqrt(true) * rng.standard_normal(count)
    config = IntegrityConfig(variance_prior=prior)
    found = [after(VarianceFactor(config), told(value, dof, 1.0), 1.0) for value in nis.tolist()]
    # As many are beyond three sigma as of a Gaussian: 54 with a deviation of 7.
    beyond = np.sum(np.square(errors) > 9.0 * np.array(found))
    assert beyond == pytest.approx(count * chi2.sf(9.0, 1), abs=30.0)
    # Within them they are smaller than it says. Errors squared have a kurtosis of at most 4.5.
    degrees = prior + dof
    smaller = degrees / (degrees - 2.0) / tails(degrees)
    assert np.mean(np.square(errors) / found) == pytest.approx(smaller, abs=0.07)


@pytest.mark.parametrize(("windows", "least"), [(0, 0.007), (2, 0.004)])
def test_one_innovation_in_a_hundred_is_unlikely_at_99_percent(windows, least):
    """Of noise whose factor is drawn from its prior, after so many windows."""
    rng = np.random.default_rng(1)
    count, prior = 20_000, 8.0
    config = IntegrityConfig(variance_prior=prior, variance_memory=1e4)
    unlikely = 0
    for true in (prior / rng.chisquare(prior, size=count)).tolist():
        factor = VarianceFactor(config)
        for window in range(windows):
            time = 3.0 * window
            factor.update(told(true * rng.chisquare(10), 10, time), time)
        newest = told(true * rng.chisquare(6), 6, 3.0 * windows)
        unlikely += factor.is_unlikely(newest, 3.0 * windows, 0.99)
    # 200 with a deviation of 14; fewer where the factor was found to be below 1, and counts as 1.
    assert least < unlikely / count < 0.013


def test_after_noisy_windows_a_noisy_one_is_not_unlikely():
    factor = VarianceFactor(CONFIG)
    assert factor.is_unlikely(told(900.0, 10, 1.0), 1.0, 0.9999)
    for time in (1.0, 3.0):
        factor.update(told(900.0, 10, time), time)
    # Of one window it tells nothing yet: both were of it.
    assert factor.is_unlikely(told(900.0, 10, 3.2), 3.2, 0.9999)
    assert not factor.is_unlikely(told(900.0, 10, 3.6), 3.6, 0.9999)
    assert factor.is_unlikely(told(9000.0, 10, 3.6), 3.6, 0.9999)


def test_after_a_restart_what_was_told_before_it_counts_at_once():
    """A prediction that began after the last innovation shares no error with it."""
    factor = VarianceFactor(CONFIG)
    factor.update(told(100.0, 10, 3.0), 3.0)
    kept = np.exp(-0.5 / 5.0)
    degrees = 5.0 + 4.0 + 10.0 * kept
    expected = (5.0 + 8.0 + 100.0 * kept) / degrees * tails(degrees)
    assert after(factor, Innovation(8.0, 4, 3.1), 3.5) == pytest.approx(expected)


@pytest.mark.parametrize("windows", [0, 2])
def test_one_sum_of_squares_in_a_hundred_is_larger_than_the_most_at_99_percent(windows):
    """Of noise whose factor is drawn from its prior, after so many windows."""
    rng = np.random.default_rng(2)
    count, prior, dof = 20_000, 8.0, 6
    config = IntegrityConfig(variance_prior=prior, variance_memory=1e4)
    larger = 0
    for true in (prior / rng.chisquare(prior, size=count)).tolist():
        factor = VarianceFactor(config)
        for time in (3.0 * np.arange(windows)).tolist():
            factor.update(told(true * rng.chisquare(10), 10, time), time)
        larger += true * rng.chisquare(dof) > factor.quantile(dof, 0.99)
    # As for innovations above.
    assert 0.004 < larger / count < 0.013
