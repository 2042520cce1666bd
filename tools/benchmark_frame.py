# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a frame between two states costs, in milliseconds, by the native kernel and by numpy.

    python tools/benchmark_frame.py

A rendered recording at 640x480 and 90 Hz is smoothed with at most 10, 20 and 30 lines; of the
frames without detection and without optimisation the stages' medians are printed, as a Markdown
table: the image gradient, the prediction of the rulings (by IMU and estimate), the search along
them, and the rest.
"""

import os
import platform
import time
from collections import defaultdict
from collections.abc import Callable
from importlib.metadata import version
from typing import Any
from unittest import mock

import numpy as np

from ruledgraph.core.config import Config, EdgesConfig
from ruledgraph.frontend.edge_batch import search_all
from ruledgraph.odometry import Odometry
from ruledgraph.simulation import Simulation, simulate
from ruledgraph_factors import active_kernel

LINES = (10, 20, 30)
SECONDS = 4.0


def kernels() -> list[str]:
    """The slower one first; the native one only if it was built."""
    os.environ.pop("RULEDGRAPH_KERNEL", None)
    return ["numpy"] if active_kernel() == "numpy" else ["numpy", "native"]


def timed(function: Callable[..., Any], into: list[float]) -> Callable[..., Any]:
    """`function`, appending to `into` how long each call took, s."""

    def call(*args: Any, **kwargs: Any) -> Any:
        start = time.perf_counter()
        result = function(*args, **kwargs)
        into.append(time.perf_counter() - start)
        return result

    return call


def run(simulation: Simulation, max_lines: int) -> tuple[float, dict[str, float]]:
    """Lines followed in a frame on average, and ms of each stage."""
    config = Config(edges=EdgesConfig(max_lines=max_lines))
    odometry = Odometry(simulation.calibration, config)
    tracker, timings = odometry.tracker, odometry.timings
    searching: list[float] = []
    following: list[float] = []
    samples: dict[str, list[float]] = defaultdict(list)
    followed: list[int] = []
    with (
        mock.patch("ruledgraph.frontend.tracker.search_all", timed(search_all, searching)),
        mock.patch.object(tracker, "track", timed(tracker.track, following)),
    ):
        for measurement in simulation.stream():
            before = {stage: timing.count for stage, timing in timings.items()}
            count = len(tracker.tracks)
            odometry.add(measurement)
            ran = {
                stage for stage, timing in timings.items() if timing.count > before.get(stage, 0)
            }
            if ran != {"frame", "gradient", "search"} or odometry.window is None:
                continue
            frame, gradient, search = (
                timings[name].last for name in ("frame", "gradient", "search")
            )
            samples["gradient"].append(gradient)
            samples["prediction"].append(search - following[-1])
            samples["search"].append(searching[-1])
            samples["rest"].append(frame - gradient - search + following[-1] - searching[-1])
            samples["frame"].append(frame)
            followed.append(count)
    medians = {stage: 1e3 * float(np.median(values)) for stage, values in samples.items()}
    return float(np.mean(followed)), medians


def main() -> None:
    """Print the table."""
    print(
        f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}, "
        f"numpy {version('numpy')}; milliseconds\n"
    )
    simulation = simulate("noncoplanar_cluttered", "free", duration=SECONDS)
    stages = ("gradient", "prediction", "search", "rest", "frame")
    print("| lines | kernel |", " | ".join(stages), "|")
    print("| ---: | --- |", " | ".join("---:" for _ in stages), "|")
    for max_lines in LINES:
        for kernel in kernels():
            os.environ["RULEDGRAPH_KERNEL"] = kernel
            lines, medians = run(simulation, max_lines)
            cells = " | ".join(f"{medians[stage]:.2f}" for stage in stages)
            print(f"| {lines:.0f} | {kernel} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
