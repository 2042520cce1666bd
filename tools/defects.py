# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated recordings with a defect that the calibration does not tell of, and what the odometry
makes of them.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import cv2
import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

import faults
from ruledgraph.app.batch.jobs import simulation_options, stem
from ruledgraph.app.run_input import RunInput
from ruledgraph.app.runner import run
from ruledgraph.calibration.rig import Calibration
from ruledgraph.core.settings import load_config
from ruledgraph.core.trajectory import read_tum
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.simulation.imu import SyntheticImu
from ruledgraph.simulation.options import simulation_from_options
from ruledgraph.simulation.simulation import Simulation

SCENES = {
    "room, from rest": "room:free?moving_start=false",
    "cluttered scene, from motion": "noncoplanar_cluttered:free?moving_start=true",
}
_IMU_RATE = 200.0
_WHITE = ("gyroscope", "accelerometer")


@dataclass(frozen=True)
class Variation:
    """How a recording differs from a good one."""

    offset_ms: float = 0.0
    """Of the clocks, t_imu - t_cam, where the calibration says 0."""
    turned_deg: float = 0.0
    """The camera, about a random axis, from where the calibration has it."""
    moved_mm: float = 0.0
    """The same in a random direction."""
    readout_ms: float = 0.0
    """Of a rolling shutter, of which the calibration says nothing."""
    focal_percent: float = 0.0
    """By which the calibration's focal length is too long."""
    imu_noise: float = 1.0
    """White noise densities, times the calibration's."""
    rate: float = 30.0
    """Frames a second."""
    size: str = "640x480"
    """Of the images, with the same field of view."""


@dataclass(frozen=True)
class Case:
    """One varied recording."""

    scene: str
    seed: int
    variation: Variation
    seconds: float

    @property
    def url(self) -> str:
        """Of its simulation."""
        own = self.variation
        camera = f"rate={own.rate:g}&resolution={own.size}&readout={1e-3 * own.readout_ms:g}"
        return f"sim:{SCENES[self.scene]}&duration={self.seconds:g}&imu_rate={_IMU_RATE:g}&{camera}"

    @property
    def key(self) -> str:
        """Names its row."""
        own = [
            f"{f.name}={v}"
            for f in fields(Variation)
            if (v := getattr(self.variation, f.name)) != f.default
        ]
        return "|".join([self.scene, f"seed {self.seed}", f"{self.seconds:g} s", *own])


@dataclass(frozen=True)
class Result:
    """What came of it."""

    frames: float
    """Share of the frames that have a live pose."""
    degraded: float
    """Share of these that are degraded."""
    live: float | None
    """ATE, mm; None without a pose."""
    smoothed: float | None
    first_pose: float | None
    """After the first frame, s."""
    recovered: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    """By fields of `Variation`: what the odometry reports at the end, how far that is from the
    truth, its standard deviation."""
    warnings: tuple[str, ...] = ()


def simulated(case: Case) -> Simulation:
    """The recording, with the truth for its calibration."""
    scene, _, motion = stem(case.url).partition(":")
    options = simulation_options(case.url)
    made = simulation_from_options(scene, motion, seed=case.seed, **options)
    true = replace(made.calibration, time_offset=1e-3 * case.variation.offset_ms)
    white = {name: case.variation.imu_noise * getattr(true.imu_noise, name) for name in _WHITE}
    noise = replace(true.imu_noise, **white)
    imu = SyntheticImu(made.motion, _IMU_RATE, noise, case.seed, made.epoch)
    return replace(made, calibration=true, imu=imu)


def told(true: Calibration, case: Case) -> Calibration:
    """The calibration that does not know of the defect."""
    rng = np.random.default_rng([case.seed, 11])
    axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    off = gtsam.Pose3(
        gtsam.Rot3.Expmap(np.radians(case.variation.turned_deg) * axis),
        1e-3 * case.variation.moved_mm * way,
    )
    scaled = faults.scaled_focal_length(true, 1.0 + 0.01 * case.variation.focal_percent)
    body_T_cam = true.body_T_cam.compose(off)
    return replace(scaled, body_T_cam=body_T_cam, time_offset=0.0, line_delay=None)


def truth_of(simulation: Simulation) -> GroundTruth:
    """At the stamps of the frames, which the time offset moves; where the calibration says nothing
    of rows they are those of the middle rows.
    """
    true, stamps = simulation.calibration, simulation.ground_truth.stamps
    states = simulation.truth(stamps + round(1e9 * true.middle_row_delay))
    quaternions = Rotation.from_matrix(states.rotation).as_quat()
    return GroundTruth(stamps - round(1e9 * true.time_offset), states.position, quaternions)


def result_of(case: Case, settings: Sequence[str] = ()) -> Result:
    """Smooth it."""
    cv2.setNumThreads(1)  # the workers share the cores
    simulation = simulated(case)
    with tempfile.TemporaryDirectory(prefix="ruledgraph-") as folder:
        output = Path(folder, "results")
        calibration = told(simulation.calibration, case)
        given = RunInput(simulation.stream(), calibration, truth_of(simulation))
        summary = run(given, load_config(None, settings), output)
        live = output / "trajectory_live.tum"
        first = int(read_tum(live).stamps[0]) if summary["frames_estimated"] else None
    percent = case.variation.focal_percent
    return figures(summary, first, simulation.calibration, percent)


def figures(
    summary: dict[str, Any], first: int | None, true: Calibration, focal_percent: float = 0.0
) -> Result:
    """From a run's summary, the stamp of its first pose, the true calibration, and by how much the
    focal length of the one that was used is too long.
    """
    ates = [
        summary.get("accuracy", {}).get(name, {}).get("ate_rmse")
        for name in ("trajectory_live", "trajectory")
    ]
    live, smoothed = (None if ate is None else 1e3 * float(ate) for ate in ates)
    estimated = summary["frames_estimated"]
    return Result(
        frames=estimated / max(summary["frames"], 1),
        degraded=summary["status"].get("degraded", 0) / max(estimated, 1),
        live=live,
        smoothed=smoothed,
        first_pose=None if first is None else 1e-9 * (first - summary["first_frame_ns"]),
        recovered=_recovered(summary, true, focal_percent),
        warnings=tuple(summary["warnings"]),
    )


def _recovered(
    summary: dict[str, Any], true: Calibration, focal_percent: float
) -> dict[str, tuple[float, float, float]]:
    found = {}
    offset, extrinsics = summary["time_offset"], summary["extrinsics"]
    if offset["estimated"]:
        error = abs(offset["s"] - true.time_offset - true.middle_row_delay)
        found["offset_ms"] = (1e3 * offset["s"], 1e3 * error, 1e3 * offset["sigma_s"])
    if extrinsics["estimated"]:
        body_T_cam = gtsam.Pose3(np.array(extrinsics["T_cam_imu"])).inverse()
        left = true.body_T_cam.rotation().logmap(body_T_cam.rotation())
        error = float(np.degrees(np.linalg.norm(left)))
        found["turned_deg"] = (extrinsics["rotation_deg"], error, extrinsics["sigma_rotation_deg"])
    focal = summary["focal_length"]
    if focal["estimated"]:
        # By how much the calibration's is too long, where the camera's own is known.
        value, sigma = 100.0 / focal["ratio"] - 100.0, 100.0 * focal["sigma_ratio"]
        found["focal_percent"] = (value, abs(value - focal_percent), sigma)
    if "readout_sigma_s" in summary:
        value, sigma = summary["readout_s"], summary["readout_sigma_s"]
        found["readout_ms"] = (1e3 * value, 1e3 * abs(value - true.readout), 1e3 * sigma)
    return found
