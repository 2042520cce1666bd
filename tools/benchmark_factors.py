# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What the factors cost, in microseconds, by the native kernel, by numpy and, with a GTSAM of your
own (CPP.md), in C++ alone.

    python tools/benchmark_factors.py

`error` and `linearize` of a factor through GTSAM for 1, 9 and 90 frames, the same of a
`CustomFactor` whose Python callback does nothing but return ready-made arrays, and
`preintegrate_frames`. Processor time, of which the fastest of several rounds counts: other work on
the machine only ever adds to it. Prints Markdown tables.
"""

import os
import platform
import time
import timeit
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, L, V, X

from ruledgraph_factors import (
    FrameMotion,
    GeometricPoints,
    ImuSamples,
    LineChart,
    ReprojectionPoints,
    active_kernel,
    native_factor,
    preintegrate_frames,
    ruled_surface_factor,
)

FRAMES = (1, 9, 90)
POINTS_PER_FRAME = 20
ROUNDS = 200
SECONDS_PER_ROUND = 0.003


def scene(frames: int) -> tuple[FrameMotion, LineChart, list[np.ndarray], gtsam.Values]:
    """A line two metres ahead and a state state; the numbers do not matter for the cost."""
    rng = np.random.default_rng(0)
    motion = FrameMotion(
        np.arange(1, frames + 1) / 90.0,
        rng.normal(size=(frames, 9)) * 0.01,
        rng.normal(size=(frames, 9, 6)) * 0.01,
        np.zeros(6),
    )
    chart = LineChart.from_points(gtsam.Pose3(), [-1.0, 0.2, 2.0], [1.0, 0.1, 2.2])
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3())
    values.insert(V(0), np.zeros(3))
    values.insert(B(0), gtsam.imuBias.ConstantBias())
    values.insert(L(0), np.zeros(4))
    return motion, chart, list(rng.normal(size=(frames, POINTS_PER_FRAME, 2)) * 0.2), values


def empty_callback_factor(rows: int) -> gtsam.CustomFactor:
    """What GTSAM's callback into Python costs by itself."""
    residual = np.zeros(rows)
    jacobians = [np.zeros((rows, width), order="F") for width in (6, 3, 6, 4)]

    def callback(
        _this: gtsam.CustomFactor, _values: gtsam.Values, H: list[np.ndarray] | None
    ) -> np.ndarray:
        if H is not None:
            for i, jacobian in enumerate(jacobians):
                H[i] = jacobian
        return residual

    noise = noiseModel.Isotropic.Sigma(rows, 1.0)
    return gtsam.CustomFactor(noise, [X(0), V(0), B(0), L(0)], callback)


def microseconds(call: Callable[[], object]) -> float:
    """Time of one call in the fastest round."""
    timer = timeit.Timer(call, timer=time.process_time)
    number, elapsed = timer.autorange()
    number = max(1, int(number * SECONDS_PER_ROUND / elapsed))
    return 1e6 * min(timer.repeat(ROUNDS, number)) / number


def kernels() -> list[str]:
    """The slower one first; the native one only if it was built."""
    os.environ.pop("RULEDGRAPH_KERNEL", None)
    return ["numpy"] if active_kernel() == "numpy" else ["numpy", "native"]


def print_row(*cells: object) -> None:
    """One line of a Markdown table."""
    print("|", " | ".join(str(cell) for cell in cells), "|")


def print_factors() -> None:
    """`error` and `linearize`."""
    names = kernels()
    in_cpp = find_spec("ruledgraph_factors._gtsam") is not None
    columns = [*names, "C++"] if in_cpp else names
    calls = [f"`{call}`, {name}" for call in ("error", "linearize") for name in columns]
    print_row("residual", "frames", "rows", *calls)
    print_row("---", *["---:"] * (2 + len(calls)))
    for kind, kind_name in ((GeometricPoints, "geometric"), (ReprojectionPoints, "reprojection")):
        for frames in FRAMES:
            motion, chart, points, values = scene(frames)
            observed = kind.from_frames(points)
            noise = noiseModel.Isotropic.Sigma(observed.rows, 1.0 / 600.0)
            factors: list[gtsam.NoiseModelFactor] = []
            for name in names:
                os.environ["RULEDGRAPH_KERNEL"] = name
                factor = ruled_surface_factor(
                    noise, X(0), V(0), B(0), L(0), motion, chart, observed
                )
                factors.append(factor)
            if in_cpp:
                factors.append(native_factor(factor.spec))
            times = [microseconds(partial(f.error, values)) for f in factors]
            times += [microseconds(partial(f.linearize, values)) for f in factors]
            print_row(kind_name, frames, observed.rows, *(f"{cost:.1f}" for cost in times))


def print_empty_callback() -> None:
    """The floor under every factor written in Python."""
    print_row("a callback that does nothing, rows", "`error`", "`linearize`")
    print_row("---:", "---:", "---:")
    for frames in FRAMES:
        _, _, _, values = scene(frames)
        for rows in (3 * frames, 2 * POINTS_PER_FRAME * frames):
            factor = empty_callback_factor(rows)
            times = [microseconds(partial(f, values)) for f in (factor.error, factor.linearize)]
            print_row(rows, *(f"{cost:.1f}" for cost in times))


def print_preintegration() -> None:
    """One state interval of 0.1 s at 90 Hz."""
    rng = np.random.default_rng(0)
    names = kernels()
    print_row("`preintegrate_frames`, IMU rate", *names)
    print_row(*["---:"] * (1 + len(names)))
    for rate in (200, 1000):
        times = np.arange(rate) / rate
        imu = ImuSamples(times, rng.normal(size=(rate, 3)), rng.normal(size=(rate, 3)))
        row = []
        for name in names:
            os.environ["RULEDGRAPH_KERNEL"] = name
            frame_times = 0.5 + np.arange(1, 10) / 90.0
            row.append(f"{microseconds(partial(preintegrate_frames, imu, 0.5, frame_times)):.0f}")
        print_row(f"{rate} Hz", *row)


def main() -> None:
    """Print the tables."""
    print(
        f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}, "
        f"gtsam {version('gtsam')}, numpy {version('numpy')}; "
        f"{POINTS_PER_FRAME} points a frame, microseconds\n"
    )
    print_factors()
    print()
    print_empty_callback()
    print()
    print_preintegration()


if __name__ == "__main__":
    main()
