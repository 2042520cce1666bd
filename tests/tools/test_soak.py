# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The soak's verdict, and a short run."""

import csv
import dataclasses

import pytest
from click.testing import CliRunner

import soak

ROW = soak.Row(10.0, 200.0, 0.5, 300, 60, 15, 0.01, 0.01, 1.0, 1, 0, 0)


@pytest.mark.parametrize(
    ("name", "growth", "good"),
    [("memory", 1.04, True), ("memory", 1.2, False), ("cost", 1.3, False), ("slots", 1.3, False)],
)
def test_what_grew_is_told(name, growth, good):
    rows = [
        dataclasses.replace(
            ROW, **{name: getattr(ROW, name) * (1.0 + (growth - 1.0) * max(0, i - 9) / 8)}
        )
        for i in range(20)
    ]
    found = {text.split()[1].strip(":"): ok for ok, text in soak.verdicts(rows)}
    assert found == {"memory": True, "cost": True, "slots": True} | {name: good}


def test_what_comes_before_the_second_quarter_does_not_count():
    rows = [dataclasses.replace(ROW, memory=100.0 if i < 5 else 200.0) for i in range(20)]
    assert all(good for good, _ in soak.verdicts(rows))


def test_a_short_run(tmp_path):
    out = tmp_path / "soak"
    arguments = ["--minutes", "0.06", "--every", "0.8", "--rate", "10", "--out", str(out)]
    result = CliRunner().invoke(soak.main, arguments)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.output
    with (out / "soak.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4
    assert 0.0 < float(rows[-1]["error"]) < 0.05
    assert int(rows[-1]["slots"]) > int(rows[-1]["variables"]) > 10
    assert float(rows[-1]["memory"]) > 50.0
    assert (out / "soak.png").stat().st_size > 10_000
    assert "memory" in result.output
