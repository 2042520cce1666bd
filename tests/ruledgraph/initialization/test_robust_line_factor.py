# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel

from ideal_tracks import CALIBRATION, ideal_tracks
from ruledgraph.backend.line_factors import compressed_points
from ruledgraph.initialization.robust_line_factor import RobustLineFactor
from ruledgraph_factors import line_from_ruling, preintegrate_frames, ruled_surface_factor
from simulated_window import hand_held

POSE, VELOCITY, BIAS, LINE = range(4)
KEYS = POSE, VELOCITY, BIAS, LINE
SIGMA = 0.5 / CALIBRATION.camera.focal_length
FRAMES, CHUNK, SCALE = 11, 4, 2.0


class Case:
    """A line over eleven frames, in chunks of four, four and three, and values that are off."""

    def __init__(self) -> None:
        made = ideal_tracks(3, hand_held(np.random.default_rng(3)), rate=20.0, duration=0.6)
        times = made.times[:FRAMES].tolist()
        samples = made.imu.between(made.times[0], made.times[-1])
        motion = preintegrate_frames(samples, times[0], times, gtsam.imuBias.ConstantBias())
        sightings = list(made.tracks[0].sightings)[:FRAMES]
        chart = line_from_ruling(CALIBRATION.body_T_cam, sightings[0].points, 0.5)

        def surface(part: slice, noise: noiseModel.Base | None = None):
            points = compressed_points(sightings[part])
            return ruled_surface_factor(
                noise or noiseModel.Unit.Create(points.rows),
                *KEYS,
                motion.select(list(range(FRAMES))[part]),
                chart,
                points,
                CALIBRATION.body_T_cam,
            )

        parts = [slice(first, first + CHUNK) for first in range(0, FRAMES, CHUNK)]
        scales = np.array([SCALE * np.sqrt(compressed_points(sightings[p]).weight) for p in parts])
        self.one = RobustLineFactor(surface(slice(None)), SIGMA, CHUNK, scales)
        self.each = gtsam.NonlinearFactorGraph()
        for part, scale in zip(parts, scales, strict=True):
            rows = compressed_points(sightings[part]).rows
            cauchy = noiseModel.mEstimator.Cauchy.Create(scale)
            noise = noiseModel.Robust.Create(cauchy, noiseModel.Isotropic.Sigma(rows, SIGMA))
            self.each.add(surface(part, noise))

    def values(self, off: float) -> gtsam.Values:
        rng = np.random.default_rng(1)
        values = gtsam.Values()
        values.insert(POSE, gtsam.Pose3().retract(off * rng.normal(size=6)))
        values.insert(VELOCITY, off * rng.normal(size=3))
        values.insert(BIAS, gtsam.imuBias.ConstantBias(*(0.1 * off * rng.normal(size=(2, 3)))))
        values.insert(LINE, off * rng.normal(size=4))
        return values


@pytest.mark.parametrize("off", [1e-3, 0.03, 0.3])
def test_it_is_a_factor_with_gtsams_robust_noise_for_each_chunk(off):
    case = Case()
    values = case.values(off)
    assert case.one.error(values) == pytest.approx(case.each.error(values), rel=1e-9)
    ordering = gtsam.Ordering()
    for key in KEYS:
        ordering.push_back(key)
    one = gtsam.NonlinearFactorGraph()
    one.add(case.one)
    found, wanted = (graph.linearize(values).hessian(ordering) for graph in (one, case.each))
    for own, theirs in zip(found, wanted, strict=True):
        np.testing.assert_allclose(own, theirs, rtol=1e-7, atol=1e-9 * np.abs(theirs).max())


def test_the_loss_holds_where_lines_are_far_off():
    # Else the comparison above would be one of least squares.
    case = Case()
    points = case.one.surface.spec.points
    far = case.values(0.3)
    quadratic = 0.5 * np.sum((case.one.surface.residual(far) / SIGMA) ** 2)
    assert case.one.error(far) < 0.1 * quadratic
    assert points.rows == 3 * FRAMES


def test_the_residual_of_a_surface_fills_the_jacobians_of_its_keys():
    case = Case()
    values, surface = case.values(0.01), case.one.surface
    blocks = [np.zeros(0)] * len(KEYS)
    residual = surface.residual(values, blocks)
    linear = surface.linearize(values)
    np.testing.assert_array_equal(np.hstack(blocks), linear.jacobian()[0])
    np.testing.assert_array_equal(residual, -linear.jacobian()[1])
