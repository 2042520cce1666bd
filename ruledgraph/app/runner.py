# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A whole recording through the odometry, with everything written down."""

import time as clock
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from ruledgraph.app.found_calibration import calibration_summary, write_found_calibration
from ruledgraph.app.interrupts import CaughtSignals
from ruledgraph.app.results import Results
from ruledgraph.app.trajectory_files import TrajectoryFormat
from ruledgraph.calibration.sensors import Calibration
from ruledgraph.core.config import Config
from ruledgraph.core.errors import RuledgraphError, machine_error
from ruledgraph.core.estimates import Estimate, Innovation, LineEstimate
from ruledgraph.core.measurements import Frame, Measurement
from ruledgraph.core.trajectory import read_tum
from ruledgraph.core.versions import machine_text, version_text
from ruledgraph.evaluation import accuracy, matched
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.odometry import Odometry
from ruledgraph.recording.read_ahead import ahead

if TYPE_CHECKING:  # its optimiser takes a third of a second to load
    from ruledgraph.baselines.paper import PaperOdometry

Solver = Literal["graph", "paper"]
"""The factor graph, or the paper's own as a baseline."""
Record: TypeAlias = Callable[[Sequence[Estimate], Sequence[Estimate], Sequence[LineEstimate]], None]
"""Takes live estimates, smoothed ones and lines."""
Watch: TypeAlias = Callable[[Odometry, Frame], None]
"""Sees the odometry when it has been given a frame."""

NO_ESTIMATE = "without estimate"
"""The status of frames without one, in the summary."""

# With estimates of fewer frames than this share, the likely causes are looked for.
_FEW = 0.5
# Measurements read ahead, a few frames' worth.
_AHEAD = 64
# Warnings listed in the summary; the rest are counted.
_MAX_WARNINGS = 50


@dataclass
class Progress:
    """How far a run is."""

    frames: int
    seconds: float
    """Of the recording."""
    lines: int
    status: str


@dataclass
class _Tally:
    frames: int = 0
    first_stamp: int | None = None
    last_stamp: int = 0
    estimates: int = 0
    line_sightings: int = 0
    lines_in_view: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    innovations: list[Innovation] = field(default_factory=list)
    edge_sigmas_px: list[float] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        return 0.0 if self.first_stamp is None else (self.last_stamp - self.first_stamp) * 1e-9


def run(
    measurements: Iterable[Measurement],
    calibration: Calibration,
    config: Config,
    output: Path,
    *,
    solver: Solver = "graph",
    ground_truth: GroundTruth | None = None,
    inputs: Mapping[str, str] | None = None,
    warnings: Callable[[], list[str]] = list,
    causes: Callable[[], list[str]] = list,
    record: Record | None = None,
    formats: Sequence[TrajectoryFormat] = (),
    watch: Watch | None = None,
    on_progress: Callable[[Progress], None] | None = None,
) -> dict[str, Any]:
    """Smooth a recording and write its results; what was computed stays, however it ends.

    Args:
        measurements: a recording's or a simulation's `stream()`.
        calibration: of camera and IMU.
        config: all settings.
        output: folder for the results, see `Results`.
        solver: the paper's has no use for `config`, and no covariances.
        ground_truth: to compare with at the end.
        inputs: what the recording, calibration and so on were, for the summary.
        warnings: asked at the end for what the recording's reader has to say.
        causes: asked at the end, when few frames were estimated, for what it may come from.
        record: is handed what is written, as it comes.
        formats: of trajectories, beside TUM's.
        watch: sees the factor graph's odometry when it has been given a frame; what it has
            processed may be the frame before, see `FrameQueue`.
        on_progress: called after each frame.

    Returns:
        What `summary.json` holds.

    Raises:
        RuledgraphError: for a recording that holds nothing to work on; `MachineError` without
            disk space, memory or threads. Results are in `output`.
    """
    odometry = _odometry(solver, calibration, config)
    reading: AbstractContextManager[Iterable[Measurement]] = nullcontext(measurements)
    if isinstance(odometry, Odometry):
        reading = closing(ahead(measurements, partial(_prepare, odometry), _AHEAD))
    tally = _Tally()
    started = clock.perf_counter()
    results = Results(output, config, formats)
    writers = [results.write, *([record] if record is not None else [])]
    first = _FirstError()
    with CaughtSignals() as caught:
        with first.kept(), reading as taken:
            for measurement in taken:
                if caught.number:
                    break
                odometry.add(measurement)
                if isinstance(measurement, Frame):
                    _hand_over(odometry, writers, tally, measurement)
                    if watch is not None and isinstance(odometry, Odometry):
                        watch(odometry, measurement)
                    if on_progress is not None:
                        on_progress(_progress(odometry, tally))
        results.use_reserve()
        with first.kept():
            odometry.finish()
        with first.kept():
            _hand_over(odometry, writers, tally, None)
        with first.kept():
            results.close()
        elapsed = clock.perf_counter() - started
        lines = [*warnings(), *odometry.warnings]
        about = {
            "versions": version_text(),
            "machine": machine_text(),
            "solver": solver,
            "inputs": dict(inputs or {}),
        }
        ended = "interrupted" if caught.number or first.is_interrupt else first.text
        summary = about | _summary(odometry, tally, elapsed, lines, ended or "complete")
        summary["lines"] = len(results.lines)
        if caught.number:
            summary["signal"] = caught.number
        with first.kept():
            if not ended and tally.estimates < _FEW * max(tally.frames, 1):
                summary["likely_causes"] = causes()
            if ground_truth is not None and tally.estimates:
                summary["accuracy"] = _accuracy(output, ground_truth)
                _note_ground_truth(output, ground_truth)
        with first.kept():
            results.summarize(summary)
            if isinstance(odometry, Odometry) and tally.estimates:
                write_found_calibration(odometry, output / "calibration.yaml")
    if first.error is not None and not first.is_interrupt:
        raise first.error
    return summary


class _FirstError:
    """What went wrong first: everything else is tried all the same."""

    def __init__(self) -> None:
        self.error: BaseException | None = None

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Keep what is raised inside, unless there was an error before."""
        try:
            yield
        except BaseException as error:  # noqa: BLE001 - raised at the end
            if self.error is None:
                self.error = machine_error(error) or error

    @property
    def is_interrupt(self) -> bool:
        """Whether it is a Ctrl-C outside the time in which signals are noted."""
        return isinstance(self.error, KeyboardInterrupt)

    @property
    def text(self) -> str:
        """In a line, empty without one."""
        if self.error is None or isinstance(self.error, RuledgraphError):
            return "" if self.error is None else str(self.error)
        return f"{type(self.error).__name__}: {self.error}"


def _odometry(
    solver: Solver, calibration: Calibration, config: Config
) -> "Odometry | PaperOdometry":
    if solver == "graph":
        return Odometry(calibration, config)
    from ruledgraph.baselines.paper import PaperOdometry

    return PaperOdometry(calibration)


def _prepare(odometry: Odometry, measurement: Measurement) -> None:
    if isinstance(measurement, Frame):
        odometry.prefetch(measurement)


def _hand_over(
    odometry: "Odometry | PaperOdometry",
    writers: Sequence[Record],
    tally: _Tally,
    frame: Frame | None,
) -> None:
    live, smoothed, lines = odometry.take_live(), odometry.take_smoothed(), odometry.take_lines()
    for write in writers:
        write(live, smoothed, lines)
    if frame is not None:
        tally.frames += 1
        tally.first_stamp = frame.stamp if tally.first_stamp is None else tally.first_stamp
        tally.last_stamp = frame.stamp
    tally.estimates += len(live)
    tally.line_sightings += len(lines)
    tally.lines_in_view += sum(estimate.lines for estimate in live)
    tally.statuses.update(estimate.status for estimate in live)
    tally.innovations += [e.innovation for e in live if e.innovation is not None]
    if isinstance(odometry, Odometry) and live and odometry.window is not None:
        tally.edge_sigmas_px.append(odometry.window.edge_sigma_px)


def _progress(odometry: "Odometry | PaperOdometry", tally: _Tally) -> Progress:
    window = odometry.window
    lines = 0 if window is None else len(window.lines)
    status, _, _ = odometry.status.partition(":")  # without the reason, which is long
    return Progress(tally.frames, tally.seconds, lines, status)


def _summary(
    odometry: "Odometry | PaperOdometry",
    tally: _Tally,
    elapsed: float,
    warnings: list[str],
    ended: str,
) -> dict[str, Any]:
    if not tally.estimates:
        warnings.append("the odometry never started")
    stages = {
        stage: {
            "count": timing.count,
            "mean_ms": 1e3 * timing.mean,
            "p99_ms": 1e3 * timing.quantile(0.99),
            "max_ms": 1e3 * timing.largest,
        }
        for stage, timing in odometry.timings.items()
    }
    statuses = dict(tally.statuses)
    if tally.estimates < tally.frames:
        statuses[NO_ESTIMATE] = tally.frames - tally.estimates
    found = calibration_summary(odometry) if isinstance(odometry, Odometry) else {}
    return found | {
        "ended": ended,
        "recording_s": tally.seconds,
        "wall_s": elapsed,
        "real_time_factor": tally.seconds / elapsed if elapsed > 0.0 else 0.0,
        "first_frame_ns": tally.first_stamp,
        "last_frame_ns": tally.last_stamp,
        "frames": tally.frames,
        "frames_estimated": tally.estimates,
        "status": statuses,
        "lines": 0,
        "line_sightings": tally.line_sightings,
        "lines_in_view": tally.lines_in_view / max(tally.estimates, 1),
        "innovations": _innovations(tally.innovations),
        "edge_sigma_px": median(tally.edge_sigmas_px) if tally.edge_sigmas_px else None,
        "recoveries": odometry.recoveries,
        "warnings": warnings[:_MAX_WARNINGS],
        "warnings_left_off": max(0, len(warnings) - _MAX_WARNINGS) + odometry.warnings.left_off,
        "stages": stages,
    }


def _innovations(of_states: Sequence[Innovation]) -> dict[str, Any]:
    """How many states have one, and their mean NIS per degree of freedom; None without any."""
    dof = sum(innovation.dof for innovation in of_states)
    nis = sum(innovation.nis for innovation in of_states)
    return {"states": len(of_states), "nis_per_dof": nis / dof if dof else None}


def _accuracy(output: Path, ground_truth: GroundTruth) -> dict[str, Any]:
    def of(name: str) -> dict[str, Any]:
        try:
            return asdict(accuracy(read_tum(output / f"{name}.tum"), ground_truth))
        except RuledgraphError as error:
            return {"error": str(error)}

    return {name: of(name) for name in ("trajectory_live", "trajectory")}


def _note_ground_truth(output: Path, ground_truth: GroundTruth) -> None:
    """Write what was known at the frames, so that the results can be shown without the source."""
    with suppress(RuledgraphError):  # they hardly overlap, which the accuracy says
        _, known = matched(read_tum(output / "trajectory_live.tum"), ground_truth)
        if known.quaternions is not None:
            known.trajectory.write_tum(output / "ground_truth.tum")
