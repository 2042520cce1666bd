# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How noisy the edge points of this camera are, by what their lines leave unexplained."""

from ruledgraph.core.config import EdgesConfig


def edge_variance(squares: float, dof: float, config: EdgesConfig) -> float:
    """The variance of edge points over that of `edges.sigma_px`.

    Residuals alone would say too little of it: a line's points err together from frame to frame,
    as on a rounded edge, and a slow error bends the estimate instead of showing in a residual. With
    r_i the whitened residuals, n their degrees of freedom and c `edges.correlation`, noise that is
    independent from frame to frame and tells as little of the motion has c times their variance,
    and n / c of them are independent. The figure counts as nu degrees of freedom
    (`edges.variance_prior`). With s^2 scaled inverse chi-square, one over the mean of 1 / s^2 is

        s^2 = (nu + sum r_i^2) / (nu + n / c).

    Args:
        squares: sum r_i^2, by `edges.sigma_px`.
        dof: n; without any, the figure stands.
        config: of edges.

    Source: Gelman et al., Bayesian Data Analysis (3rd edition, 2013), 3.2.
    """
    independent = max(dof, 0.0) / config.correlation
    used = squares if independent > 0.0 else 0.0
    return (config.variance_prior + used) / (config.variance_prior + independent)
