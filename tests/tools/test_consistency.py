# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The table of consistency and its bounds, and a short run that goes on."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import consistency
from consistency import DIMENSION, PARTS


def test_bounds_hold_what_is_consistent():
    """95 % of means and medians over 50 draws from chi squared lie within, to 4 deviations."""
    rng = np.random.default_rng(0)
    draws = np.sum(rng.normal(size=(4000, 50, DIMENSION)) ** 2, axis=2)
    of_mean, of_median = consistency.bounds(50)
    means = draws.mean(axis=1) / DIMENSION
    # scipy's chi2.median(3)
    medians = np.median(draws, axis=1) / 2.3659738843753377
    for found, (low, high) in ((means, of_mean), (medians, of_median)):
        inside = np.mean((found > low) & (found < high))
        assert inside == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 4000))


def row(start: str, seed: int, scale: float) -> dict:
    """Of a run whose covariances are too small by `scale`, 200 states."""
    rng = np.random.default_rng([seed, len(start)])
    nees = scale * np.sum(rng.normal(size=(200, DIMENSION)) ** 2, axis=1) / DIMENSION
    known = {"start": start, "seed": seed, "still": 200 * [False]}
    return known | {part: nees.tolist() for part in PARTS}


def test_the_table_says_by_what_factor_it_is_off():
    rows = [row("at rest", seed, 1.0) for seed in range(50)]
    rows += [row("in motion", seed, 3.0) for seed in range(50)]
    lines = consistency.table(rows).splitlines()
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines[2:]]
    assert [(line[0], line[3]) for line in cells] == [
        (start, part) for start in consistency.STARTS for part in PARTS
    ]
    for line in cells:
        expected = 1.0 if line[0] == "at rest" else 3.0
        # 10,000 draws: 0.8 % and 1.2 % of deviation, and two digits.
        assert float(line[4]) == pytest.approx(expected, rel=0.04)
        assert float(line[6]) == pytest.approx(expected, rel=0.06)
        assert float(line[8]) == pytest.approx(expected, abs=0.2)
        assert line[5] == "0.79 to 1.24"  # scipy's chi2.ppf([0.025, 0.975], 150) / 150


def test_nodes_held_still_are_counted_apart():
    rows = [row("at rest", seed, 0.1) for seed in range(10)]
    for i, own in enumerate(rows):
        own["still"] = [n < 20 + i for n in range(200)]
        for part in PARTS:
            own[part] = np.where(own["still"], 0.1, 1.0).tolist()
    lines = [line.split("|") for line in consistency.table(rows).splitlines()[2:]]
    found = {(line[2].strip(), float(line[5])) for line in lines}
    assert found == {("moving", 1.0), ("held still", 0.1)}


def test_what_has_no_error_is_far_off():
    held = row("at rest", 0, 0.0)
    held["still"] = 200 * [True]
    lines = consistency.table([held]).splitlines()[2:]
    assert len(lines) == len(consistency.PARTS)
    assert all(line.endswith("| far |") for line in lines)


def test_a_setting_that_there_is_not():
    result = CliRunner().invoke(consistency.main, ["--set", "edges.nothing=1"])
    assert result.exit_code == 2
    assert "edges.nothing: no such setting" in result.output


def test_a_run_that_goes_on(tmp_path):
    out = tmp_path / "rows.jsonl"
    out.write_text("".join(json.dumps(row("at rest", seed, 1.0)) + "\n" for seed in range(2)))
    arguments = ["--runs", "3", "--seconds", "3", "--rate", "15", "--start", "at rest"]
    result = CliRunner().invoke(consistency.main, [*arguments, "--out", str(out)])
    assert result.exception is None, result.output
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    assert [r["seed"] for r in rows] == [0, 1, 2]
    assert len(rows[2]["position"]) > 5
    assert np.all(np.isfinite(rows[2]["gyroscope bias"]))
    assert "| at rest | moving | 3 | position |" in result.output
