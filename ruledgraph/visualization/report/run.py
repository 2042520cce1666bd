# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A results folder, read for the report. What others may have written into it is checked."""

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruledgraph.core.config import Config
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.settings import load_config
from ruledgraph.core.trajectory import read_tum
from ruledgraph.evaluation import Accuracy, accuracy
from ruledgraph.evaluation.ground_truth import GroundTruth

TRAJECTORIES = {"trajectory_live": "live", "trajectory": "smoothed"}
"""Name of the file, without its suffix -> what the page calls it."""


class ReportError(RuledgraphError):
    """A folder that holds no run, or a page that cannot be written."""


@dataclass(frozen=True)
class Stage:
    """How long a stage of the odometry took."""

    name: str
    count: int
    mean_ms: float
    p99_ms: float
    max_ms: float


@dataclass(frozen=True)
class Setting:
    """One of `config.yaml`."""

    section: str
    key: str
    value: str
    default: str
    """The default's value of today."""

    @property
    def name(self) -> str:
        """As `--set` takes it."""
        return f"{self.section}.{self.key}"

    @property
    def changed(self) -> bool:
        """Whether it is not the default."""
        return self.value != self.default


@dataclass(frozen=True)
class Run:
    """What a results folder says of its run."""

    folder: Path
    ended: str
    about: dict[str, str]
    """Recording, calibration, versions, machine: what of that was noted."""
    first_stamp: int | None
    """Of the first frame, ns, if it was noted."""
    recording_s: float
    wall_s: float
    real_time_factor: float
    frames: int
    frames_estimated: int
    statuses: dict[str, int]
    lines: int
    lines_in_view: float
    recoveries: list[str]
    warnings: list[str]
    warnings_left_off: int
    stages: list[Stage]
    errors: dict[str, Accuracy]
    """Of the `live` and the `smoothed` trajectory; empty without ground truth."""
    not_evaluated: list[str]
    """Why some trajectory has no errors."""
    settings: list[Setting]
    settings_text: str
    """`config.yaml` as it is, where it cannot be read as settings."""

    @property
    def name(self) -> str:
        """The folder's."""
        return self.folder.resolve().name

    @property
    def frames_missing(self) -> int:
        """Frames without an estimate."""
        return max(self.frames - self.frames_estimated, 0)

    @property
    def warning_count(self) -> int:
        """Of the listed ones and those left off."""
        return len(self.warnings) + self.warnings_left_off


def _why_none(folder: Path, error: OSError) -> str:
    if not folder.exists():
        return f"{folder} does not exist"
    if any(folder.glob("*/summary.json")):
        return f"{folder}: its folders hold a run each; name them: ruledgraph report {folder}/*/"
    return f"{folder}: no results of a run that has ended: summary.json: {error.strerror}"


def read_run(folder: Path, truth: GroundTruth | None) -> Run:
    """Read a results folder.

    Args:
        folder: as `ruledgraph smooth` wrote it.
        truth: evaluate against this, not as the run's own summary says.

    Raises:
        ReportError: for a folder that holds no run that has ended.
    """
    path = folder / "summary.json"
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ReportError(_why_none(folder, error)) from None
    except (ValueError, RecursionError):
        raise ReportError(f"{path}: is not JSON") from None
    found = _evaluated(folder, truth) if truth is not None else None
    settings, text = _settings(folder / "config.yaml")
    try:
        errors, why_not = _errors(summary.get("accuracy", {})) if found is None else found
        return Run(
            folder=folder,
            ended=str(summary["ended"]),
            about=_about(summary),
            first_stamp=_stamp(summary.get("first_frame_ns")),
            recording_s=float(summary["recording_s"]),
            wall_s=float(summary["wall_s"]),
            real_time_factor=float(summary["real_time_factor"]),
            frames=int(summary["frames"]),
            frames_estimated=int(summary["frames_estimated"]),
            statuses={str(name): int(count) for name, count in summary["status"].items()},
            lines=int(summary["lines"]),
            lines_in_view=float(summary["lines_in_view"]),
            recoveries=_texts(summary["recoveries"]),
            warnings=_texts(summary["warnings"]),
            warnings_left_off=int(summary["warnings_left_off"]),
            stages=[_stage(str(name), times) for name, times in summary["stages"].items()],
            errors=errors,
            not_evaluated=why_not,
            settings=settings,
            settings_text=text,
        )
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        what = f"lacks {error}" if isinstance(error, KeyError) else str(error)
        raise ReportError(f"{path}: is no summary of a run: {what}") from None


def own_truth(folder: Path) -> GroundTruth | None:
    """The ground truth that the run noted, at its frames; None if it had none."""
    try:
        known = read_tum(folder / "ground_truth.tum")
    except RuledgraphError:
        return None
    return GroundTruth(known.stamps, known.positions, known.quaternions)


def _texts(values: Any) -> list[str]:
    if not isinstance(values, list):
        raise TypeError("warnings and recoveries must be lists")
    return [str(value) for value in values]


def _about(summary: dict[str, Any]) -> dict[str, str]:
    found = {str(name): str(value) for name, value in summary.get("inputs", {}).items()}
    for name in ("solver", "versions", "machine"):
        if name in summary:
            found[name] = str(summary[name])
    return found


def _stamp(value: Any) -> int | None:
    return None if value is None else int(value)


def _stage(name: str, times: dict[str, Any]) -> Stage:
    return Stage(
        name,
        int(times["count"]),
        *(float(times[f"{statistic}_ms"]) for statistic in ("mean", "p99", "max")),
    )


def _errors(accuracies: dict[str, Any]) -> tuple[dict[str, Accuracy], list[str]]:
    found, why_not = {}, []
    for file, name in TRAJECTORIES.items():
        figures = accuracies.get(file)
        if figures is None:
            continue
        if "error" in figures:
            why_not.append(f"{name}: {figures['error']}")
            continue
        _, *fields = dataclasses.fields(Accuracy)
        numbers = [figures[field.name] for field in fields]
        found[name] = Accuracy(
            int(figures["poses"]),
            *(None if number is None else float(number) for number in numbers),  # type: ignore[arg-type]
        )
    return found, why_not


def _evaluated(folder: Path, truth: GroundTruth) -> tuple[dict[str, Accuracy], list[str]]:
    found, why_not = {}, []
    for file, name in TRAJECTORIES.items():
        try:
            found[name] = accuracy(read_tum(folder / f"{file}.tum"), truth)
        except RuledgraphError as error:  # noqa: PERF203 - two of them
            why_not.append(f"{name}: {error}")
    return found, why_not


def _settings(path: Path) -> tuple[list[Setting], str]:
    try:
        config = load_config(path).model_dump()
    except RuledgraphError:  # another version's, or none
        try:
            return [], path.read_text(encoding="utf-8", errors="replace")
        except OSError:
            return [], ""
    default = Config().model_dump()
    settings = [
        Setting(section, key, _shown(value), _shown(default[section][key]))
        for section, values in config.items()
        for key, value in values.items()
    ]
    return settings, ""


def _shown(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
