# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Does the module of C++ factors fit the GTSAM that runs? See `native_factor` and CPP.md.

    python -m ruledgraph_factors.gtsam_self_test

Says so in one line; the exit code is 0 if it does. The test runs in a process of its own: a module
for another GTSAM may take that down.
"""

import signal
import subprocess
import sys

import gtsam
import numpy as np

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.graph_io import build_factor
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.motion import STANDARD_GRAVITY, FrameMotion
from ruledgraph_factors.native_factor import native_factor
from ruledgraph_factors.observations import GeometricPoints
from ruledgraph_factors.spec import RuledSurfaceSpec

BOUND = 1e-12
"""On the difference from the factor in Python, relative to the largest number."""

_COMPARE = "from ruledgraph_factors.gtsam_self_test import compare; print(compare())"
_ERROR = f"{FactorError.__module__}.{FactorError.__qualname__}"


def example() -> tuple[RuledSurfaceSpec, gtsam.Values]:
    """A factor of two frames, and values for it."""
    rng = np.random.default_rng(1)
    preintegrated, bias_jacobian = rng.normal(size=(2, 9)), rng.normal(size=(2, 9, 6))
    points = GeometricPoints.from_frames(list(rng.uniform(-0.5, 0.5, size=(2, 6, 2))))
    values = gtsam.Values()
    values.insert(0, gtsam.Pose3(gtsam.Rot3.Expmap(np.full(3, 0.1)), np.full(3, 0.2)))
    values.insert(1, rng.normal(size=3))
    values.insert(2, gtsam.imuBias.ConstantBias(rng.normal(size=3) * 0.1, np.full(3, 0.01)))
    values.insert(3, rng.normal(size=4) * 0.02)
    spec = RuledSurfaceSpec(
        form="node",
        keys=(0, 1, 2, 3),
        noise_model=gtsam.noiseModel.Isotropic.Sigma(points.rows, 0.01),
        chart=LineChart.from_points(gtsam.Pose3(), [-0.5, 0.0, 2.0], [0.5, 0.3, 2.5]),
        motion=FrameMotion(
            np.array([0.01, 0.03]), 0.02 * preintegrated, 0.05 * bias_jacobian, np.zeros(6)
        ),
        points=points,
        body_T_cam=gtsam.Pose3(gtsam.Rot3.Expmap(np.full(3, -0.1)), np.full(3, 0.05)),
        gravity=np.array(STANDARD_GRAVITY),
    )
    return spec, values


def compare() -> str:
    """Compare a C++ factor, cloned by GTSAM within a graph, with the one in Python.

    Raises:
        FactorError: when they differ, or when there is no module.
    """
    spec, values = example()
    python, graph = build_factor(spec), gtsam.NonlinearFactorGraph()
    graph.add(native_factor(spec))
    native = graph.clone().at(0)
    error = python.error(values)
    system = python.linearize(values).augmentedJacobian()
    by_error = abs(native.error(values) - error) / error
    by_system = np.abs(native.linearize(values).augmentedJacobian() - system) / np.abs(system).max()
    worst = float(np.max([by_error, by_system.max()]))
    if not worst <= BOUND:
        raise FactorError(f"error and Jacobian differ from Python's by {worst:.1e}")
    return f"error and Jacobian of a cloned factor are within {worst:.1e} of Python's"


def self_test(compare_in_python: str = _COMPARE) -> tuple[bool, str]:
    """Whether the module fits this GTSAM, and why, in one line."""
    done = subprocess.run(  # noqa: S603 - this interpreter
        [sys.executable, "-c", compare_in_python], capture_output=True, text=True, check=False
    )
    if done.returncode == 0:
        return True, f"ruledgraph_factors._gtsam fits this GTSAM: {done.stdout.strip()}"
    if done.returncode < 0:
        reason = f"the test died of {signal.Signals(-done.returncode).name}"
    else:
        reason = done.stderr.strip().rpartition("\n")[2].removeprefix(f"{_ERROR}: ")
    return False, f"ruledgraph_factors._gtsam does not fit this GTSAM: {reason}"


if __name__ == "__main__":
    fits, text = self_test()
    print(text)
    sys.exit(0 if fits else 1)
