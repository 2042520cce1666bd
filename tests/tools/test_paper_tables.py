# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The tool that makes the paper's tables: its rows, its report, and a short run."""

import json
from functools import partial

import numpy as np
import pytest
from click.testing import CliRunner

import paper_runs
import paper_tables
from paper_figures import ROWS
from paper_runs import SOLVERS, Case
from paper_tables import main, report
from ruledgraph.simulation import simulate


def test_rows_are_the_papers():
    assert [sum(row.table == table for row in ROWS) for table in range(1, 6)] == [5, 15, 5, 2, 4]
    assert len({(row.scene, row.motion, row.first_seed) for row in ROWS}) == 31
    assert all(len(row.printed) == (10 if row.table == 5 else 6) for row in ROWS)
    by_name = {(row.table, row.name): row.printed for row in ROWS}
    assert by_name[2, "linear perpendicular, rotation Z"][-2:] == (0.0313, 0.0306)
    assert by_name[3, "linear tilted"][:2] == (0.0255, 0.0221)
    assert by_name[5, "non-coplanar 2"][-2:] == (0.3419, 0.1990)


def test_the_report_averages_over_the_seeds():
    row = next(row for row in ROWS if row.table == 5)
    cases = [Case(row, seed, 12.0) for seed in (1, 11)]
    results = {}
    for case, x in zip(cases, (0.01, -0.03), strict=True):
        lines = [0.1, 0.2, 0.3, 0.4]
        paper = {"paper": [x, 0.002, 0, 0, 0, 0], "lines": lines}
        graph = {"live": [x] * 6, "smoothed": [0.0] * 6, "lines": lines}
        graph |= {"live ate": 0.0123, "smoothed ate": 0.002}
        results[case.key("paper")], results[case.key("graph")] = paper, graph
    results[cases[1].key("graph")] = {"failed": "it never started"}
    text = report(cases, results)
    assert "that are not public" in text
    x, line_2 = "0.0236 ± 0.0147 | 0.0200 ± 0.0020 | 0.0100 ± 0.0100", "0.0591 ± 0.0339"
    assert f"| coplanar 1 | X | {x} | 0.0000 ± 0.0000 |" in text
    assert f"|  | line 2 | {line_2} | 0.3000 ± 0.4000 | - | 0.3000 ± 0.4000 |" in text
    assert (
        "live: mean error at most a fifth of the printed one on 0 of 3 axes; smaller than the "
        "paper's solver's in 1 of 1 rows; ATE (RMSE) 12.3 mm median, 12.3 mm worst"
    ) in text
    assert "|  | missing | factor graph, live 1 of 2; factor graph, smoothed 1 of 2 |" in text


def test_a_run_goes_on_where_it_was_interrupted(tmp_path, monkeypatch):
    def fake(case, solvers):
        return [{"key": case.key(name), "seconds": 1.0, "failed": "fake"} for name in solvers]

    def in_process(work, items, workers):
        assert workers == 2
        return ((item, work(item)) for item in items)

    monkeypatch.setattr(paper_tables, "in_parallel", in_process)
    monkeypatch.setattr(paper_tables, "run", fake)
    rows = tmp_path / "rows.jsonl"
    arguments = ["--table", "4", "--rows", str(rows), "--out", str(tmp_path / "tables.md")]
    assert CliRunner().invoke(main, [*arguments, "--solver", "graph"]).exit_code == 0
    assert len(rows.read_text().splitlines()) == 2
    assert CliRunner().invoke(main, arguments).exit_code == 0
    keys = [json.loads(line)["key"] for line in rows.read_text().splitlines()]
    assert len(keys) == len(set(keys)) == 4
    assert "paper's solver, ours 1 of 1" in (tmp_path / "tables.md").read_text()


def test_both_solvers_are_run_on_the_same_recording(monkeypatch):
    monkeypatch.setattr(paper_runs, "simulate", partial(simulate, rate=30.0))
    row = next(row for row in ROWS if row.name == "coplanar 1")
    results = paper_runs.run(Case(row, 1, 1.8), SOLVERS)
    assert [result["key"].split("/")[-1] for result in results] == ["paper", "graph"]
    paper, graph = results
    for figures in (paper["paper"], graph["live"], graph["smoothed"]):
        assert np.abs(figures).max() < 0.1
    assert np.isfinite(paper["lines"]).all()
    assert paper["lines"][0] == pytest.approx(0.0, abs=1.0)
