# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A row of the paper's tables: its recording simulated, run through both solvers, and compared."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from paper_figures import Row
from ruledgraph.baselines.paper import PaperOdometry
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.estimates import Estimate
from ruledgraph.core.measurements import ImuSample
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation import accuracy, axis_differences, point_line_distances
from ruledgraph.evaluation.ground_truth import GroundTruth
from ruledgraph.odometry import Odometry
from ruledgraph.simulation import Simulation, simulate

SOLVERS = ("paper", "graph")
# Table 5: the two lines with markers, and where along their edges these are.
_MARKED = ("left", "right")
_MARKERS = np.array([0.1, 0.5, 0.9])
# The paper's solver's lines are compared this often, in windows.
_EVERY = 15


@dataclass(frozen=True)
class Case:
    """A row with one seed."""

    row: Row
    seed: int
    duration: float

    def key(self, solver: str) -> str:
        """Names a result."""
        return f"{self.row.scene}/{self.row.motion}/{self.seed}/{self.duration:g}/{solver}"


Sightings = dict[int, list[tuple[int, FloatArray]]]
"""Of each estimated line: stamps, and two points (2, 3) in the estimate's world, m."""


def run(case: Case, solvers: Sequence[str]) -> list[dict[str, Any]]:
    """Simulate once, and give it to the solvers; a result of each."""
    simulation = simulate(case.row.scene, case.row.motion, seed=case.seed, duration=case.duration)
    calibration = simulation.calibration
    running: dict[str, Odometry | PaperOdometry] = {
        name: PaperOdometry(calibration) if name == "paper" else Odometry(calibration)
        for name in solvers
    }
    taken = {name: _Taken() for name in solvers}
    seconds = dict.fromkeys(solvers, 0.0)
    for measurement in simulation.stream():
        for name, odometry in running.items():
            started = time.perf_counter()
            odometry.add(measurement)
            seconds[name] += time.perf_counter() - started
            if not isinstance(measurement, ImuSample):
                taken[name].take(odometry)
    for name, odometry in running.items():
        odometry.finish()
        taken[name].take(odometry)
    truth = _truth(simulation)
    results = []
    for name in solvers:
        result: dict[str, Any] = {"key": case.key(name), "seconds": round(seconds[name], 1)}
        try:
            result |= taken[name].figures(name, simulation, truth, case.row.table == 5)
        except RuledgraphError as error:
            result["failed"] = str(error)
        results.append(result)
    return results


class _Taken:
    """What came out of a solver."""

    def __init__(self) -> None:
        self.live: list[Estimate] = []
        self.smoothed: list[Estimate] = []
        self.lines: Sightings = {}
        self._windows = 0

    def take(self, odometry: Odometry | PaperOdometry) -> None:
        self.live += odometry.take_live()
        self.smoothed += odometry.take_smoothed()
        segments = odometry.take_lines()
        if isinstance(odometry, PaperOdometry):
            for rulings in odometry.take_rulings():
                if self._windows % _EVERY == 0:
                    for number, ends in enumerate(rulings.ends):
                        self.lines.setdefault(number, []).append((rulings.stamp, ends))
                self._windows += 1
        else:
            for line in segments:
                self.lines.setdefault(line.id, []).append((line.last_stamp, line.ends))

    def figures(
        self, solver: str, simulation: Simulation, truth: GroundTruth, with_lines: bool
    ) -> dict[str, Any]:
        """Mean and deviation by axis, of the distances of two lines, and ATE (RMSE), m."""
        columns = {"paper": self.smoothed} if solver == "paper" else {}
        if solver == "graph":
            columns = {"live": self.live, "smoothed": self.smoothed}
        figures: dict[str, Any] = {}
        for column, estimates in columns.items():
            if len(estimates) < 3:
                raise RuledgraphError("it never started")
            found = axis_differences(
                _trajectory(estimates), truth, simulation.calibration.body_T_cam
            )
            figures[column] = np.stack([found.mean, found.std], axis=1).ravel().tolist()
            figures[f"{column} ate"] = accuracy(_trajectory(estimates), truth).ate_rmse
        if with_lines:
            figures["lines"] = _line_figures(self.lines, self.smoothed, simulation)
        return figures


def _truth(simulation: Simulation) -> GroundTruth:
    true = simulation.ground_truth
    quaternions = Rotation.from_matrix(true.rotation).as_quat()
    return GroundTruth(true.stamps, true.position, quaternions)


def _trajectory(estimates: Sequence[Estimate]) -> Trajectory:
    return Trajectory.from_poses([e.stamp for e in estimates], [e.world_T_body for e in estimates])


def _line_figures(
    lines: Sightings, smoothed: Sequence[Estimate], simulation: Simulation
) -> list[float]:
    """Mean and deviation of the distance of two true lines' markers from the estimated ones.

    As the paper does it in camera coordinates: the estimated line as seen from the estimated
    camera, the markers as seen from the true one. An estimated line stands for the true one whose
    edge it is nearest to.
    """
    poses = {estimate.stamp: estimate.world_T_body for estimate in smoothed}
    in_body = {
        number: [
            (stamp, poses[stamp].transformTo(ends.T).T)
            for stamp, ends in sightings
            if stamp in poses
        ]
        for number, sightings in lines.items()
    }
    figures: list[float] = []
    for bar in _MARKED:
        best: FloatArray | None = None
        for edge in _long_edges(simulation, bar):
            markers = edge[0] + _MARKERS[:, None] * (edge[1] - edge[0])
            for sightings in in_body.values():
                distances = [
                    point_line_distances(_seen(simulation, stamp, markers), ends)
                    for stamp, ends in sightings
                ]
                if distances and (best is None or np.mean(distances) < best.mean()):
                    best = np.array(distances)
        figures += [float("nan")] * 2 if best is None else [float(best.mean()), float(best.std())]
    return figures


def _seen(simulation: Simulation, stamp: int, points: FloatArray) -> FloatArray:
    """Points (N, 3) of the world in the true body frame."""
    true = simulation.truth([stamp])
    return np.asarray((points - true.position[0]) @ true.rotation[0])


def _long_edges(simulation: Simulation, bar: str) -> list[FloatArray]:
    """The edges along a bar, (2, 3) each, m."""
    return [
        ends
        for name, ends in zip(simulation.line_names, simulation.lines, strict=True)
        if name.split(".")[0] == bar and np.linalg.norm(ends[1] - ends[0]) > 0.3
    ]
