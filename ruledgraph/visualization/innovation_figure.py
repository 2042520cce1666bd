# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Normalised innovations over time, with the bounds they should keep."""

import numpy as np
from matplotlib.figure import Figure

from ruledgraph.core import figure_style as style
from ruledgraph.core.arrays import FloatArray
from ruledgraph.visualization.run_tables import RunTables

_INSIDE = 0.95
# A running mean over so many states: over fewer, chance moves it by more than a fifth.
_MEAN_OVER = 10
# Between states that follow one another there is less, s.
_GAP = 1.0


def innovation_figure(run: RunTables) -> Figure | None:
    """Normalised innovation squared of each state over its degrees of freedom, with the bounds that
    hold 95 % of them when the noise figures of IMU and edges are right.

    Returns:
        None where no state has one.
    """
    # Loaded here: it takes half a second.
    from scipy.stats import chi2

    nis, dof = run.states.get("nis", np.zeros(0)), run.states.get("nis_dof", np.zeros(0))
    known = np.isfinite(nis) & (dof > 0.0)
    if not known.any():
        return None
    nis, dof, times = nis[known], dof[known], run.times[known]
    low, high = (chi2.ppf(0.5 * (1.0 + side * _INSIDE), dof) / dof for side in (-1.0, 1.0))
    ratio = nis / dof
    inside = float(np.mean((ratio >= low) & (ratio <= high)))
    with style.figure_style():
        figure = style.new_figure(12.0, 3.2)
        axes = figure.subplots()
        at, bottom, top = _apart(times, low, high)
        axes.fill_between(
            at, bottom, top, color=style.MUTED, alpha=0.2, lw=0, label="bounds of 95 %"
        )
        axes.plot(times, ratio, ".", ms=4.0, color=style.LIVE, label="one state")
        if len(ratio) >= _MEAN_OVER:
            weights = np.full(_MEAN_OVER, 1.0 / _MEAN_OVER)
            means = _apart(*(np.convolve(row, weights, "valid") for row in (times, ratio)))
            axes.plot(*means, color=style.SMOOTHED, label=f"mean of {_MEAN_OVER} states")
        meaning = "1: errors as the noise figures say; above it larger, below it smaller"
        axes.axhline(1.0, color=style.MUTED, lw=0.8, label=meaning)
        axes.set_yscale("log")
        axes.set_title("normalised innovation squared per degree of freedom")
        share = f"mean {nis.sum() / dof.sum():.2f} (1 expected), {100 * inside:.0f} % within bounds"
        axes.set_title(share, loc="right", fontweight="normal", fontsize=8.5)
        axes.set_xlabel("time (s)")
        figure.legend(loc="outside lower center", ncols=4, fontsize=8.5)
    return figure


def _apart(times: FloatArray, *rows: FloatArray) -> list[FloatArray]:
    """Times and rows with NaN in gaps, such as rests, so that nothing is drawn across them."""
    gaps = np.flatnonzero(np.diff(times) > _GAP) + 1
    return [np.insert(row, gaps, np.nan) for row in (times, *rows)]
