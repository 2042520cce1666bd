# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The table of consistency and its bounds, and a short run that goes on."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import consistency
from consistency import DIMENSION, PARTS
from ruledgraph.core.config import Config
from ruledgraph.core.measurements import ImuSample

FLIGHTS = Path(__file__).parents[3] / "shared" / "data" / "euroc_motion"


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
    found = {"still": 200 * [False]} | {part: nees.tolist() for part in PARTS}
    return {"start": start, "seed": seed, "live": found}


def cells(rows) -> list[list[str]]:
    lines = consistency.table(rows).splitlines()[2:]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]


def test_the_table_says_by_what_factor_it_is_off():
    rows = [row("at rest", seed, 1.0) for seed in range(50)]
    rows += [row("in motion", seed, 3.0) for seed in range(50)]
    found = cells(rows)
    assert [(line[0], line[4]) for line in found] == [
        (start, part) for start in ("at rest", "in motion") for part in PARTS
    ]
    for line in found:
        expected = 1.0 if line[0] == "at rest" else 3.0
        # 10,000 draws: 0.8 % and 1.2 % of deviation, and two digits.
        assert float(line[5]) == pytest.approx(expected, rel=0.04)
        assert float(line[7]) == pytest.approx(expected, rel=0.06)
        assert float(line[9]) == pytest.approx(expected, abs=0.2)
        assert line[6] == "0.79 to 1.24"  # scipy's chi2.ppf([0.025, 0.975], 150) / 150
        # 1 - scipy's chi2.cdf(chi2.ppf(0.9973, 3) / expected, 3)
        beyond = 0.27 if expected == 1.0 else 19.4
        assert float(line[10]) == pytest.approx(beyond, abs=max(0.2, 0.1 * beyond))


def test_nodes_held_still_are_counted_apart():
    rows = [row("at rest", seed, 0.1) for seed in range(10)]
    for i, own in enumerate(row["live"] for row in rows):
        own["still"] = [n < 20 + i for n in range(200)]
        for part in PARTS:
            own[part] = np.where(own["still"], 0.1, 1.0).tolist()
    found = {(line[2], float(line[5])) for line in cells(rows)}
    assert found == {("moving", 1.0), ("held still", 0.1)}


def test_what_has_no_error_is_far_off():
    held = row("at rest", 0, 0.0)
    held["live"]["still"] = 200 * [True]
    assert [line[9] for line in cells([held])] == len(consistency.PARTS) * ["far"]


def test_kinds_of_estimates_are_counted_apart():
    both = row("in motion", 0, 1.0)
    both["smoothed"] = row("in motion", 0, 2.0)["live"]
    found = {line[1]: float(line[5]) for line in cells([both]) if line[4] == "velocity"}
    assert found["smoothed"] == pytest.approx(2.0 * found["live"], abs=0.02)


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
    for kind in ("live", "smoothed"):
        assert len(rows[2][kind]["position"]) > 20  # of all frames
        assert np.all(np.isfinite(rows[2][kind]["gyroscope bias"]))
    assert "| at rest | live | moving | 3 | position |" in result.output


def test_a_noisy_imu_has_the_noise_that_is_assumed():
    assumed = Config().imu
    quiet, noisy = (
        consistency.simulated(start, 0, 2.0, 15.0, assumed)
        for start in ("in motion", f"in motion{consistency.NOISY}")
    )
    noise = noisy.calibration.imu_noise
    assert noise.accelerometer == assumed.min_accelerometer_noise
    assert noise.gyroscope == assumed.min_gyroscope_noise
    spread = [
        np.std(np.diff([m.accelerometer for m in s.stream() if isinstance(m, ImuSample)], axis=0))
        for s in (quiet, noisy)
    ]
    # Of the differences of white noise, m/s^2 at 200 Hz, to 4 deviations; the motion's are small.
    assert spread[1] == pytest.approx(np.sqrt(2.0 * 200.0) * noise.accelerometer, rel=0.1)
    assert spread[0] < 0.3 * spread[1]


def test_flights_need_their_folder():
    result = CliRunner().invoke(consistency.main, ["--start", "V1_01_easy"])
    assert result.exit_code == 2
    assert "flights need --flights" in result.output


@pytest.mark.skipif(
    not FLIGHTS.is_dir(), reason="the EuRoC recordings are not beside the repository"
)
def test_a_stretch_of_a_flight(tmp_path):
    out = tmp_path / "rows.jsonl"
    arguments = ["--runs", "1", "--seconds", "5", "--start", "V1_01_easy"]
    arguments += ["--flights", str(FLIGHTS), "--out", str(out)]
    result = CliRunner().invoke(consistency.main, arguments)
    assert result.exception is None, result.output
    (found,) = (json.loads(line) for line in out.read_text().splitlines())
    assert np.all(np.isfinite(found["live"]["accelerometer bias"]))
    assert "| V1_01_easy | live | moving | 1 | velocity |" in result.output
