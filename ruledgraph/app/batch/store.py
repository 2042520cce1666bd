# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A batch's folder: a folder of results for each run, and tables of all."""

import csv
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ruledgraph.app.batch.jobs import Job
from ruledgraph.app.batch.work import Outcome
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.visualization.report import write_batch_report
from ruledgraph.visualization.report.batch import grouped

_COLUMNS = (
    "run",
    "recording",
    "settings",
    "seed",
    "error",
    "frames",
    "frames_estimated",
    "ate_live_mm",
    "ate_smoothed_mm",
    "rpe_smoothed_mm_per_m",
    "recoveries",
    "warnings",
    "real_time_factor",
)


class Store:
    """Where a batch's outcomes are kept; each is whole as soon as its folder bears its name.

    Raises:
        RuledgraphError: when the folder cannot be made or belongs to something else.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            others = [p for p in folder.iterdir() if p.is_dir() and not _is_ours(p)]
        except OSError as error:
            raise RuledgraphError(f"{folder}: cannot be written: {error.strerror}") from None
        if others:
            raise RuledgraphError(
                f"{folder}: holds {others[0].name}, which is no batch's; name another folder with "
                "--output"
            )

    def error(self, job: Job) -> str | None:
        """Why a run failed, empty if it did not; None when it has not been run."""
        known = self._read(job, "job.json")
        return str(known["error"]) if known else None

    def put(self, job: Job, outcome: Outcome) -> None:
        """Keep what came of a run, in place of what was there of it."""
        part, final = self.folder / f".{job.name}.part", self.folder / job.name
        for path in (part, final):
            shutil.rmtree(path, ignore_errors=True)
        part.mkdir()
        for name, content in outcome.files.items():
            (part / name).parent.mkdir(exist_ok=True)
            (part / name).write_bytes(content)
        about = {**job.as_dict(), "error": outcome.error}
        (part / "job.json").write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
        part.rename(final)

    def write_tables(self, jobs: Sequence[Job]) -> list[Path]:
        """Write `table.csv`, a row for each run, and `table.md` and `report.html`, a row for each
        choice of settings and recording: median, least and most over its runs.
        """
        rows = [self._row(job) for job in jobs if self.error(job) is not None]
        paths = [self.folder / name for name in ("table.csv", "table.md", "report.html")]
        with paths[0].open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, _COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
        paths[1].write_text(_markdown(rows), encoding="utf-8")
        write_batch_report(rows, paths[2])
        return paths

    def _row(self, job: Job) -> dict[str, Any]:
        summary = self._read(job, "summary.json") or {}
        accuracy = summary.get("accuracy", {})
        live, smoothed = accuracy.get("trajectory_live", {}), accuracy.get("trajectory", {})
        row = {
            "run": job.name,
            "recording": job.recording,
            "settings": " ".join(job.settings),
            "seed": job.seed,
            "error": self.error(job),
            "ate_live_mm": _millimetres(live.get("ate_rmse")),
            "ate_smoothed_mm": _millimetres(smoothed.get("ate_rmse")),
            "rpe_smoothed_mm_per_m": _millimetres(smoothed.get("rpe_rmse")),
        }
        for key in ("frames", "frames_estimated"):
            row[key] = summary.get(key)
        for key in ("recoveries", "warnings"):
            row[key] = len(summary[key]) if key in summary else None
        factor = summary.get("real_time_factor")
        return row | {"real_time_factor": None if factor is None else f"{factor:.2f}"}

    def _read(self, job: Job, name: str) -> dict[str, Any] | None:
        try:
            found = json.loads((self.folder / job.name / name).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return dict(found)


def _is_ours(folder: Path) -> bool:
    return (folder / "job.json").is_file() or folder.name.endswith(".part")


def _millimetres(metres: float | None) -> str | None:
    return None if metres is None else f"{1e3 * metres:.2f}"


def _markdown(rows: Sequence[dict[str, Any]]) -> str:
    lines = [
        "Median and range over the runs of a row; ATE is the RMSE after SE(3) alignment.",
        "",
        "| recording | settings | runs | failed | live ATE, mm | smoothed ATE, mm |",
        "|---|---|---:|---:|---:|---:|",
    ]
    for group in grouped(rows):
        shown = [group.shown(key) for key in ("ate_live_mm", "ate_smoothed_mm")]
        counts = [str(len(group.rows)), str(group.failed)]
        cells = [group.recording, group.settings or "defaults", *counts, *shown]
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    if failures := [row for row in rows if row["error"]]:
        lines += ["", "Failed:", ""]
        lines += [f"- `{row['run']}`: {row['error']}" for row in failures]
    return "\n".join(lines) + "\n"
