# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Accuracy of the odometry: real recordings, real motion in rendered rooms, simulated motions.

    python tools/benchmark_accuracy.py --data DATA
    python tools/benchmark_accuracy.py --only square/ --seeds 3
    python tools/benchmark_accuracy.py --only free --ablation

ATE is evo's, SE(3)-aligned without scale, in mm, of the live and of the smoothed trajectory. NEES
is a degree of freedom's, of the live states against simulated truth, and should be 1. Lines are
compared with the scene's, as each left the window / as in the map: precision is the share of
lines within 5 cm of a true one, recall the share of true ones in view that have such a line; edges
that are painted or hidden count against them. Rows are kept in --out as they come; a run that
was interrupted goes on.
"""

import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import gtsam
import numpy as np

from ruledgraph.app.batch.cluster import in_parallel
from ruledgraph.backend.line_merging import merged_lines
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.config import DEFAULTS
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.estimates import Estimate, LineEstimate
from ruledgraph.core.measurements import Frame, Measurement
from ruledgraph.core.settings import load_config
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import accuracy
from ruledgraph.evaluation.ground_truth import GroundTruth, read_ground_truth
from ruledgraph.evaluation.line_maps import line_map_accuracy, points_in_view
from ruledgraph.integrity.gauge import yaw_alignment
from ruledgraph.odometry import Odometry
from ruledgraph.simulation import MOTIONS, Simulation
from ruledgraph.simulation.options import simulation_from_options
from state_nees import nees

ABLATION = {
    "": (),
    "without bounded rulings": ("edges.bounded=false",),
    "without robust loss": ("lines.cauchy_scale_px=0",),
    "Hough": ("edges.detector=hough",),
    "IMU only": ("edges.max_lines=2", "tracks.min_length_px=9999"),
}
REAL_SLICE = Path("euroc_MH_01_30s", "MH_01_30s")
"""The real recording in the folder of data, without the suffix of its files."""
MAPS = (
    ("room", "free"),
    ("room", "circular-parallel-rot-y"),
    ("noncoplanar_cluttered", "free"),
    ("square_cluttered", "linear-parallel-rot-y"),
    ("corridor", "walk"),
)
"""Scenes and motions whose lines are seen several times, but for the corridor's."""
REAL_MOVING = 16.0
"""It moves so long, s, and then stands still."""


@dataclass(frozen=True)
class Case:
    """What is run."""

    name: str
    options: dict[str, Any]
    """Of the simulation; of a real recording its files."""
    seed: int = 0
    variant: str = ""

    @property
    def key(self) -> str:
        """Names the row."""
        return f"{self.name}|{self.seed}|{self.variant}"


def cases(data: Path | None, seeds: int) -> Iterator[Case]:
    """All cases; the real ones where there is `data`."""
    if data is not None:
        bag = data / REAL_SLICE
        yield Case("real/MH_01, 30 s", {"bag": str(bag)})
        yield Case("real/MH_01, moving 16 s", {"bag": str(bag), "duration": REAL_MOVING})
        for scene, flight, start in (
            ("room", "V1_01_easy", 0.0),
            ("hall", "MH_04_difficult", 15.0),
        ):
            folder = data / "euroc_motion" / flight
            yield Case(
                f"flight/{flight} in a {scene}, 60 s",
                {
                    "scene": scene,
                    "motion": str(folder / "groundtruth.csv"),
                    "imu": str(folder / "imu0.csv"),
                    "calibration": str(bag) + ".calib.yaml",
                    "rate": 20.0,
                    "start": start,
                    "duration": 60.0,
                },
            )
    for seed in range(seeds):
        for motion in MOTIONS:
            if motion not in ("free", "walk"):
                yield Case(f"square/{motion}", {"scene": "square", "motion": motion}, seed)
        for motion in ("circular-parallel", "circular-parallel-rot-y", "free"):
            yield Case(f"noncoplanar/{motion}", {"scene": "noncoplanar", "motion": motion}, seed)
        free = {"scene": "noncoplanar_cluttered", "motion": "free"}
        yield Case("cluttered/free", free, seed)
        yield Case("moving start/cluttered, free", {**free, "moving_start": True}, seed)
        for scene, motion in MAPS:
            short = {"scene": scene, "motion": motion, "rate": 30.0, "duration": 8.0}
            yield Case(f"map/{scene}, {motion}", short, seed)
        walk = {"scene": "corridor", "motion": "walk", "duration": 30.0}
        yield Case("corridor/walk", walk, seed)


def run(case: Case) -> dict[str, Any]:
    """Run a case; a row of figures."""
    simulation = None
    if "bag" in case.options:
        stream, calibration, truth = real_recording(
            case.options["bag"], case.options.get("duration")
        )
    else:
        simulation = simulation_from_options(**case.options, seed=case.seed)
        stream, calibration = simulation.stream(), simulation.calibration
        truth = _truth(simulation)
    odometry = Odometry(calibration, load_config(None, ABLATION[case.variant]))
    live: list[Estimate] = []
    smoothed: list[Estimate] = []
    lines: list[LineEstimate] = []
    frames, started = 0, time.perf_counter()
    for measurement in stream:
        frames += isinstance(measurement, Frame)
        odometry.add(measurement)
        live += odometry.take_live()
        smoothed += odometry.take_smoothed()
        lines += odometry.take_lines()
    odometry.finish()
    live += odometry.take_live()
    smoothed += odometry.take_smoothed()
    lines += odometry.take_lines()
    row: dict[str, Any] = {
        "frames": frames,
        "estimated": len(live),
        "recoveries": len(odometry.recoveries),
        "lines in view": float(np.mean([e.lines for e in live])) if live else 0.0,
        "seconds": time.perf_counter() - started,
        "smoother": odometry.timings["smoother"].total,
        "search": odometry.timings["search"].total,
    }
    if len(live) < 3:
        return row | {"failed": "; ".join(odometry.warnings[-2:]) or "no start"}
    for name, estimates in (("live", live), ("smoothed", smoothed)):
        found = accuracy(_trajectory(estimates), truth)
        row |= {name: 1e3 * found.ate_rmse, f"{name} max": 1e3 * found.ate_max}
        row["path"] = found.path_length
    if simulation is not None:
        row |= _mean_nees(live, smoothed[0], simulation)
        row |= _line_errors(lines, smoothed, simulation)
    return row


def real_recording(
    bag: str, duration: float | None = None
) -> tuple[Iterator[Measurement], Calibration, GroundTruth]:
    """Measurements, calibration and truth of `bag`.bag, beside which lie the other two."""
    from ruledgraph.calibration import read_calibration
    from ruledgraph.recording import open_recording

    recording = open_recording(Path(f"{bag}.bag"), duration=duration)
    calibration = read_calibration(Path(f"{bag}.calib.yaml"))
    return recording.stream(), calibration, read_ground_truth(f"{bag}.gt.tum")


def _truth(simulation: Simulation) -> GroundTruth:
    true = simulation.ground_truth
    poses = [
        gtsam.Pose3(gtsam.Rot3(R), p) for R, p in zip(true.rotation, true.position, strict=True)
    ]
    trajectory = Trajectory.from_poses(true.stamps, poses)
    return GroundTruth(trajectory.stamps, trajectory.positions, trajectory.quaternions)


def _trajectory(estimates: Sequence[Estimate]) -> Trajectory:
    return Trajectory.from_poses([e.stamp for e in estimates], [e.world_T_body for e in estimates])


def _mean_nees(
    live: Sequence[Estimate], beginning: Estimate, simulation: Simulation
) -> dict[str, float]:
    found = nees([e for e in live if e.at_state], beginning, simulation)
    return {f"nees {name}": float(found[name].mean()) for name in ("pose", "velocity", "bias")}


def _line_errors(
    lines: Sequence[LineEstimate], smoothed: Sequence[Estimate], simulation: Simulation
) -> dict[str, float]:
    """Of the lines as each left the window, and of the map, where repeated sightings are merged.

    Position and heading of the world are aligned, also where a motion is along a line.
    """
    true = simulation.truth([e.stamp for e in smoothed])
    yaw = yaw_alignment(true.rotation, np.array([e.matrix[:3, :3] for e in smoothed])).matrix()
    shift = (true.position - [yaw @ e.position for e in smoothed]).mean(axis=0)
    camera, body_T_cam = simulation.calibration.camera, simulation.calibration.body_T_cam
    centres = true.position + true.rotation @ body_T_cam.translation()
    rotations = true.rotation @ body_T_cam.rotation().matrix()
    in_view = points_in_view(simulation.lines.mean(axis=1), camera, rotations, centres)
    figures: dict[str, float] = {}
    for name, found in (("sightings", lines), ("map", merged_lines(lines, DEFAULTS.map))):
        ends = np.reshape([line.ends for line in found], (-1, 2, 3)) @ yaw.T + shift
        compared = line_map_accuracy(ends, simulation.lines, in_view)
        figures |= {f"{name} {part}": x for part, x in compared._asdict().items()}
    return figures


def _attempt(case: Case) -> dict[str, Any]:
    try:
        return asdict(case) | run(case)
    except RuledgraphError as error:
        return asdict(case) | {"failed": str(error)}


def report(rows: Sequence[dict[str, Any]]) -> str:
    """A Markdown table: a line for each case and variant, median and worst over the seeds."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["name"], row["variant"]), []).append(row)
    header = (
        "case",
        "seeds",
        "path (m)",
        "live (mm), median / worst",
        "smoothed (mm), median / worst",
        "lines seen / in map",
        "precision",
        "recall",
        "lines per true line",
        "line ends (mm)",
        "NEES pose / velocity / bias",
        "recoveries",
        "failed",
    )
    table = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    for (name, variant), group in groups.items():
        good = [row for row in group if "failed" not in row]

        def spread(key: str, good: list[dict[str, Any]] = good) -> str:
            values = [row[key] for row in good if key in row]
            return f"{np.median(values):.1f} / {max(values):.1f}" if values else "-"

        def median(key: str, times: float = 1.0, good: list[dict[str, Any]] = good) -> str:
            values = [times * row[key] for row in good if np.isfinite(row.get(key, np.nan))]
            return f"{np.median(values):.2f}" if values else "-"

        def both(part: str, times: float = 1.0) -> str:
            return " / ".join(median(f"{name} {part}", times) for name in ("sightings", "map"))

        cells = (
            f"{name} {variant}".strip(),
            str(len(group)),
            median("path"),
            spread("live"),
            spread("smoothed"),
            both("lines"),
            both("precision"),
            both("recall"),
            both("repeats"),
            both("distance", 1e3),
            " / ".join(median(f"nees {part}") for part in ("pose", "velocity", "bias")),
            str(sum(row["recoveries"] for row in good)),
            str(len(group) - len(good)),
        )
        table.append("| " + " | ".join(cells) + " |")
    return "\n".join(table)


@click.command(help=__doc__)
@click.option("--data", type=click.Path(exists=True, path_type=Path), help="Real recordings.")
@click.option("--seeds", default=1, show_default=True, help="Of the simulated cases.")
@click.option("--only", default="", help="Cases whose name contains this.")
@click.option("--ablation", is_flag=True, help="Each case also without parts of the method.")
@click.option("--jobs", default=2, show_default=True, help="Processes.")
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Rows, JSON lines.")
def main(
    data: Path | None, seeds: int, only: str, ablation: bool, jobs: int, out: Path | None
) -> None:
    """Command line."""
    chosen = [case for case in cases(data, seeds) if only in case.name]
    if ablation:
        chosen = [Case(c.name, c.options, c.seed, v) for c in chosen for v in ABLATION]
    rows: dict[str, dict[str, Any]] = {}
    if out is not None and out.exists():
        for line in out.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            rows[Case(row["name"], {}, row["seed"], row["variant"]).key] = row
    todo = [case for case in chosen if case.key not in rows]
    for done, (case, row) in enumerate(in_parallel(_attempt, todo, workers=jobs), start=1):
        rows[case.key] = row
        figures = {k: round(row[k], 2) for k in ("live", "smoothed", "seconds") if k in row}
        failed = row.get("failed", "")
        print(f"{done}/{len(todo)} {case.key} {figures} {failed}", file=sys.stderr, flush=True)
        if out is not None:
            with out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    print(report([rows[case.key] for case in chosen if case.key in rows]))


if __name__ == "__main__":
    main()
