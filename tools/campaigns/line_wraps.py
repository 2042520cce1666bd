# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Can a line's coordinates wrap without a word? Thousands of lines, started badly on purpose.

Each line is random, 1 to 8 m away, seen in five views with a pixel of noise; it starts from one
view at a distance that is up to ten times wrong, and from a random turn in its plane, and is
solved by Levenberg-Marquardt with the prior of a new line. One that ends with |delta| >= pi/2 has
wrapped or may have (`LineChart.is_far`). That is silent if `check_lines` calls the line good, or if
the prior pulls at more than the smallest delta of the same line:

    python tools/campaigns/line_wraps.py [LINES]
"""

import sys
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam import noiseModel
from gtsam.symbol_shorthand import L, X

import ruledgraph_factors as rf
from ruledgraph.app.batch.cluster import in_parallel

SIGMA = 1.0 / 500.0  # a pixel
VIEWS = 5
WIDE = noiseModel.Diagonal.Sigmas(np.array(rf.NEW_LINE_SIGMAS))
PART = 500  # lines that a worker takes at a time
HELD = noiseModel.Isotropic.Sigma(6, 1e-4)


class Outcome(NamedTuple):
    """Of one line."""

    far: bool
    reported: bool
    """`check_lines` objects."""
    pulled: bool
    """The prior pulls at more than the smallest delta."""
    moved: bool
    """The smallest delta is another line."""


def run(seed: int) -> Outcome:
    """Solve one line."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform([-0.4, -0.4, 1.0], [0.4, 0.4, 1.0]) * rng.uniform(1.0, 8.0)
    half = rng.normal(size=3)
    half *= 0.3 * middle[2] / np.linalg.norm(half)
    steps = rng.normal(size=(VIEWS, 3)) * [0.1, 0.1, 0.02]  # not into the line
    cameras = [gtsam.Pose3(gtsam.Rot3(), j * step) for j, step in enumerate(steps)]
    frames = []
    for camera in cameras:
        ends = np.array([camera.transformTo(middle + sign * half) for sign in (-1.0, 1.0)])
        image = ends[:, :2] / ends[:, 2:]
        along = rng.uniform(size=(20, 1))
        noise = rng.normal(scale=SIGMA, size=(20, 2))
        frames.append(image[0] + along * (image[1] - image[0]) + noise)
    wrong = 10.0 ** rng.uniform(-1.0, 1.0) / np.linalg.norm(middle)
    chart = rf.line_from_ruling(cameras[0], frames[0], wrong)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise_model = noiseModel.Isotropic.Sigma(3, SIGMA)
    for j, (camera, seen) in enumerate(zip(cameras, frames, strict=True)):
        points = rf.GeometricPoints.from_frames([seen])
        graph.add(rf.ruled_surface_pose_factor(noise_model, X(j), L(0), chart, points))
        graph.addPriorPose3(X(j), camera, HELD)
        values.insert(X(j), camera)
    prior = rf.new_line_factor(WIDE, X(0), L(0), chart, cameras[0])
    graph.add(prior)
    values.insert(L(0), np.array([0.0, rng.uniform(-1.5, 1.5), 0.0, 0.0]))
    params = rf.levenberg_marquardt_params()
    found = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    delta = found.atVector(L(0))
    smallest, _ = chart.wrapped(delta)
    moment, direction = np.split(chart.plucker(smallest)[0], 2)
    there = chart.plucker(delta)[0]
    same = min(np.linalg.norm(chart.plucker(smallest)[0] - sign * there) for sign in (-1.0, 1.0))
    moved = same > 1e-9 or np.linalg.norm(chart.local(moment, direction) - smallest) > 1e-6
    # What the poses' own small motion adds to the prior's residual is left out at 1e-3.
    pulled = np.linalg.norm(prior.unwhitenedError(found)) > np.linalg.norm(smallest) + 1e-3
    reported = not rf.check_lines(graph, found)[0].ok
    return Outcome(chart.is_far(delta), reported, bool(pulled), bool(moved))


def main() -> None:
    """Print the counts."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    parts = [range(count)[i : i + PART] for i in range(0, count, PART)]
    found = in_parallel(lambda part: [run(seed) for seed in part], parts, workers=2)
    outcomes = [outcome for _, of_part in found for outcome in of_part]
    far = [outcome for outcome in outcomes if outcome.far]
    print(f"{count} lines, {len(far)} ended far from their chart's reference, of these")
    print(f"  not reported by check_lines: {sum(not outcome.reported for outcome in far)}")
    print(f"of all, pulled by more than the smallest delta: {sum(o.pulled for o in outcomes)}")
    print(f"of all, another line by its smallest delta: {sum(o.moved for o in outcomes)}")


if __name__ == "__main__":
    main()
