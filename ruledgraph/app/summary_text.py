# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What `ruledgraph smooth` says at its end, from the summary of the run."""

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

_KINDS = {"trajectory": "smoothed", "trajectory_live": "live"}
_WIDTH = 13


def summary_text(summary: Mapping[str, Any], output: Path, *, rerun: Path | None = None) -> str:
    """A table of one row for each thing a person asks first, and the command to go on with."""
    rows = [*_frames(summary), *_accuracy(summary.get("accuracy", {})), *_offset(summary)]
    if summary["frames_estimated"]:
        rows += [*_extrinsics(summary), *_focal_length(summary), *_edges(summary)]
        rows += _innovations(summary)
    speed = f"{summary['recording_s']:.1f} s of recording in {summary['wall_s']:.1f} s"
    if summary["recording_s"] > 0.0:
        speed += f", {summary['real_time_factor']:.2f} times real time"
    rows += [("Speed", speed), ("Results", str(output))]
    if rerun is not None:
        rows.append(("Rerun", f"rerun {shlex.quote(str(rerun))}"))
    if summary["frames_estimated"]:
        rows.append(("Next", f"ruledgraph report {shlex.quote(str(output))}"))
    return "\n".join(f"{name:<{_WIDTH}}{text}" for name, text in rows)


def short_text(summary: Mapping[str, Any]) -> str:
    """The same in a few words: how many frames were estimated, and how accurately."""
    text = f"{summary['frames_estimated']} of {summary['frames']} frames estimated"
    for name, kind in _KINDS.items():
        found = summary.get("accuracy", {}).get(name, {})
        if "ate_rmse" in found:
            text += f", ATE {kind} {1e3 * found['ate_rmse']:.1f} mm"
    return text


def _frames(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    frames, estimated = summary["frames"], summary["frames_estimated"]
    yield "Frames", f"{estimated} of {frames} estimated{_share(estimated, frames)}"
    if estimated:
        statuses = summary["status"].items()
        yield "Status", ", ".join(f"{name} {100 * n / frames:.1f} %" for name, n in statuses)
    recoveries, sightings = len(summary["recoveries"]), summary["line_sightings"]
    times = "once" if recoveries == 1 else f"{recoveries} times"
    yield (
        "Lines",
        f"{summary['lines']} in the map, seen {sightings} times, "
        f"{summary['lines_in_view']:.1f} in view on average"
        + (f"; smoother rebuilt {times}" if recoveries else ""),
    )


def _accuracy(accuracies: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, kind in _KINDS.items():
        found = accuracies.get(name)
        if found is None:
            continue
        if "error" in found:
            yield f"ATE {kind}", str(found["error"])
            continue
        text = (
            f"{1e3 * found['ate_rmse']:.1f} mm RMSE, {1e3 * found['ate_max']:.1f} mm at most, "
            f"over {found['path_length']:.1f} m"
        )
        if found["rpe_rmse"] is not None:
            text += f"; drift {1e3 * found['rpe_rmse']:.1f} mm per metre (RPE)"
        yield f"ATE {kind}", text


def _offset(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if "readout_s" in summary:
        sigma = summary.get("readout_sigma_s")
        known = "as given" if sigma is None else f"± {1e3 * sigma:.1f} ms, found in the images"
        yield "Readout", f"{1e3 * summary['readout_s']:.1f} ms of a rolling shutter, {known}"
    offset = summary.get("time_offset")
    if not offset:
        return
    given = f"{1e3 * offset['given_s']:+.1f} ms as given"
    if not offset["estimated"]:
        yield "Time offset", f"{given}, not estimated"
        return
    if not summary["frames_estimated"] and offset["s"] == offset["given_s"]:
        yield "Time offset", given
        return
    value, sigma = 1e3 * offset["s"], 1e3 * offset["sigma_s"]
    yield "Time offset", f"t_imu - t_cam = {value:+.2f} ± {sigma:.2f} ms, estimated; {given}"


def _extrinsics(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    found = summary.get("extrinsics")
    if not found:
        return
    if not found["estimated"]:
        yield "Extrinsics", "as given, not estimated"
        return
    yield (
        "Extrinsics",
        f"camera turned by {found['rotation_deg']:.2f} ± {found['sigma_rotation_deg']:.2f} deg, "
        f"moved by {1e3 * found['translation_m']:.1f} ± {1e3 * found['sigma_translation_m']:.1f} "
        "mm from the calibration's, estimated",
    )


def _focal_length(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    found = summary.get("focal_length")
    if not found:
        return
    if not found["estimated"]:
        yield "Focal length", "as given, not estimated"
        return
    change, sigma = 100.0 * (found["ratio"] - 1.0), 100.0 * found["sigma_ratio"]
    yield "Focal length", f"{change:+.2f} ± {sigma:.2f} % from the calibration's, estimated"


def _edges(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    sigma = summary.get("edge_sigma_px")
    if sigma is not None:
        yield "Edges", f"{sigma:.1f} px of noise (median), found from the lines' residuals"


def _innovations(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    found = summary["innovations"]
    if found["nis_per_dof"] is not None:
        yield (
            "Innovations",
            f"NIS {found['nis_per_dof']:.1f} per degree of freedom, 1 where the noise figures are "
            f"right; over {found['states']} states",
        )


def _share(part: int, whole: int) -> str:
    return f" ({100 * part / whole:.1f} %)" if whole else ""
