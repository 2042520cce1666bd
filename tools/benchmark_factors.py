# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What a factor costs: microseconds for `error` and `linearize` through GTSAM.

    python tools/benchmark_factors.py

For 1, 9 and 90 frames, beside the same call on a `CustomFactor` whose Python callback does nothing
but return ready-made arrays of the same size. The fastest of several rounds counts: other work on
the machine only ever adds time. Prints a Markdown table.
"""

import platform
import timeit
from collections.abc import Callable
from importlib.metadata import version

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, L, V, X

from ruledgraph_factors import (
    CompressedPoints,
    FrameMotion,
    IndividualPoints,
    LineChart,
    ruled_surface_factor,
)

FRAMES = (1, 9, 90)
POINTS_PER_FRAME = 20
ROUNDS = 15
SECONDS_PER_ROUND = 0.05


def scene(frames: int) -> tuple[FrameMotion, LineChart, list[np.ndarray], gtsam.Values]:
    """A line two metres ahead and a knot state; the numbers do not matter for the cost."""
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


def microseconds(call: Callable[[gtsam.Values], object], values: gtsam.Values) -> float:
    """Time of one call in the fastest round."""
    timer = timeit.Timer(lambda: call(values))
    number, elapsed = timer.autorange()
    number = max(1, int(number * SECONDS_PER_ROUND / elapsed))
    return 1e6 * min(timer.repeat(ROUNDS, number)) / number


def main() -> None:
    """Print the table."""
    print(
        f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}, "
        f"gtsam {version('gtsam')}, numpy {version('numpy')}; "
        f"{POINTS_PER_FRAME} points a frame, numpy kernel, microseconds\n"
    )
    print("| factor | frames | rows | error | linearize |")
    print("|---|---:|---:|---:|---:|")
    for frames in FRAMES:
        motion, chart, points, values = scene(frames)
        factors: dict[str, gtsam.CustomFactor] = {}
        for name, kind in (("geometric", CompressedPoints), ("reprojection", IndividualPoints)):
            observed = kind.from_frames(points)
            noise = noiseModel.Isotropic.Sigma(observed.rows, 1.0 / 600.0)
            factors[name] = ruled_surface_factor(
                noise, X(0), V(0), B(0), L(0), motion, chart, observed
            )
        factors["empty callback"] = empty_callback_factor(3 * frames)
        for name, factor in factors.items():
            error = microseconds(factor.error, values)
            linearize = microseconds(factor.linearize, values)
            print(f"| {name} | {frames} | {factor.dim()} | {error:.0f} | {linearize:.0f} |")


if __name__ == "__main__":
    main()
