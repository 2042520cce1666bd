# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A run in figures: what `summary.json` holds."""

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from ruledgraph.app.found_calibration import calibration_summary
from ruledgraph.app.solvers import AnyOdometry, Solver
from ruledgraph.app.steps import Step
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.estimates import Innovation, nis_per_dof
from ruledgraph.core.trajectory import read_tum
from ruledgraph.core.versions import machine_text, version_text
from ruledgraph.evaluation import accuracy, matched
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.odometry import Odometry

NO_ESTIMATE = "without estimate"
"""The status of frames without one."""

# Warnings that are listed; the rest are counted.
_MAX_WARNINGS = 50


@dataclass
class Tally:
    """What is counted during a run."""

    frames: int = 0
    first_stamp: int | None = None
    """Of a frame, ns."""
    last_stamp: int = 0
    """Likewise."""
    estimates: int = 0
    map_lines: int = 0
    """Known at the end."""
    line_sightings: int = 0
    lines_in_view: int = 0
    """Of all estimates together."""
    statuses: Counter[str] = field(default_factory=Counter)
    innovations: list[Innovation] = field(default_factory=list)
    edge_sigmas_px: list[float] = field(default_factory=list)

    @property
    def reliable(self) -> int:
        """Estimates that are not `degraded`."""
        return self.estimates - self.statuses["degraded"]

    @property
    def seconds(self) -> float:
        """From the first frame to the last."""
        return 0.0 if self.first_stamp is None else (self.last_stamp - self.first_stamp) * 1e-9

    def add(self, step: Step) -> None:
        """Count what a step has brought."""
        if step.frame is not None:
            stamp = step.frame.stamp
            self.frames += 1
            self.first_stamp = stamp if self.first_stamp is None else self.first_stamp
            self.last_stamp = stamp
        self.estimates += len(step.live)
        self.line_sightings += len(step.lines)
        self.lines_in_view += sum(estimate.lines for estimate in step.live)
        self.statuses.update(estimate.status for estimate in step.live)
        self.innovations += [e.innovation for e in step.live if e.innovation is not None]
        odometry = step.odometry
        if isinstance(odometry, Odometry) and step.live and odometry.window is not None:
            self.edge_sigmas_px.append(odometry.window.edge_sigma_px)


def about(solver: Solver, inputs: Mapping[str, str]) -> dict[str, Any]:
    """The part of the summary that says with what, and of what, it was made."""
    return {
        "versions": version_text(),
        "machine": machine_text(),
        "solver": solver,
        "inputs": dict(inputs),
    }


def figures(
    odometry: AnyOdometry, tally: Tally, *, ended: str, wall_s: float, warnings: Sequence[str]
) -> dict[str, Any]:
    """The part of the summary that says what came of it, times in s or as their names say.

    Args:
        odometry: when it has finished.
        tally: of the whole run.
        ended: "complete", "interrupted", or the error that ended it.
        wall_s: what the run took.
        warnings: of the recording and the odometry.
    """
    all_warnings = [*warnings, *([] if tally.estimates else ["the odometry never started"])]
    statuses = dict(tally.statuses)
    if tally.estimates < tally.frames:
        statuses[NO_ESTIMATE] = tally.frames - tally.estimates
    found = calibration_summary(odometry) if isinstance(odometry, Odometry) else {}
    return found | {
        "ended": ended,
        "recording_s": tally.seconds,
        "wall_s": wall_s,
        "real_time_factor": tally.seconds / wall_s if wall_s > 0.0 else 0.0,
        "first_frame_ns": tally.first_stamp,
        "last_frame_ns": tally.last_stamp,
        "frames": tally.frames,
        "frames_estimated": tally.estimates,
        "status": statuses,
        "lines": tally.map_lines,
        "line_sightings": tally.line_sightings,
        "lines_in_view": tally.lines_in_view / max(tally.estimates, 1),
        "innovations": {
            "states": len(tally.innovations),
            "nis_per_dof": nis_per_dof(tally.innovations),
        },
        "edge_sigma_px": median(tally.edge_sigmas_px) if tally.edge_sigmas_px else None,
        "recoveries": odometry.recoveries,
        "warnings": all_warnings[:_MAX_WARNINGS],
        "warnings_left_off": max(0, len(all_warnings) - _MAX_WARNINGS) + odometry.warnings.left_off,
        "stages": _stages(odometry),
    }


def accuracies(folder: Path, ground_truth: GroundTruth) -> dict[str, Any]:
    """The errors of both trajectories in a folder of results, or why there are none."""

    def of(name: str) -> dict[str, Any]:
        try:
            return asdict(accuracy(read_tum(folder / f"{name}.tum"), ground_truth))
        except RuledgraphError as error:
            return {"error": str(error)}

    return {name: of(name) for name in ("trajectory_live", "trajectory")}


def write_ground_truth(folder: Path, ground_truth: GroundTruth) -> None:
    """Write what was known at the frames, so that the results can be shown without the source."""
    with suppress(RuledgraphError):  # they hardly overlap, which the accuracy says
        _, known = matched(read_tum(folder / "trajectory_live.tum"), ground_truth)
        if known.quaternions is not None:
            known.trajectory.write_tum(folder / "ground_truth.tum")


def _stages(odometry: AnyOdometry) -> dict[str, Any]:
    return {
        stage: {
            "count": timing.count,
            "mean_ms": 1e3 * timing.mean,
            "p99_ms": 1e3 * timing.quantile(0.99),
            "max_ms": 1e3 * timing.largest,
        }
        for stage, timing in odometry.timings.items()
    }
