# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

"""A first window's linear solution."""

import gtsam
import numpy as np
import pytest

from ideal_tracks import MANY, IdealTracks, ideal_tracks
from ruledgraph.simulation import imu as simulated_imu
from ruledgraph_factors import GeometricPoints, preintegrate_frames
from ruledgraph_factors.closed_form import ClosedForm, Planes, closed_form, gyroscope_bias
from simulated_window import BODY_T_CAM, FOCAL_LENGTH, hand_held


def planes_of(made: IdealTracks) -> list[Planes]:
    """Of the lines of a window, seen in all of its frames at half a pixel."""
    frames, body_R_cam = range(len(made.times)), BODY_T_CAM.rotation().matrix()
    each = [GeometricPoints.from_frames([s.points for s in t.sightings]) for t in made.tracks]
    return [Planes.of(frames, points, body_R_cam, 0.5 / FOCAL_LENGTH) for points in each]


def solved(
    made: IdealTracks, lines: list[Planes], gyroscope: np.ndarray, gravity: float = 9.81
) -> ClosedForm:
    """With the gyroscope's bias that is believed, rad/s."""
    times = made.times.tolist()
    samples = made.imu.between(times[0], times[-1])
    bias = gtsam.imuBias.ConstantBias(np.zeros(3), gyroscope)
    motion = preintegrate_frames(samples, times[0], times, bias)
    return closed_form(motion, lines, BODY_T_CAM.translation(), gravity)


@pytest.mark.parametrize("seed", range(5))
def test_bias_velocity_gravity_and_lines_without_initial_values(seed):
    rng = np.random.default_rng(seed)
    bias = np.concatenate([np.zeros(3), rng.normal(scale=0.06, size=3)])
    made = ideal_tracks(seed, hand_held(rng), rate=20.0, duration=1.0, bias=bias)
    lines = planes_of(made)
    samples = made.imu.between(made.times[0], made.times[-1])
    found_bias = gyroscope_bias(samples, made.times.tolist(), lines, 0.1)
    # A second of 20 frames of 12 lines at half a pixel.
    np.testing.assert_allclose(found_bias, bias[3:], atol=0.01)
    found = solved(made, lines, found_bias)
    body_R_world = made.motion.rotation(0.0).T
    # Good enough to begin with: the linear residuals are not the geometric ones.
    np.testing.assert_allclose(found.velocity, body_R_world @ made.motion.velocity(0.0), atol=0.15)
    np.testing.assert_allclose(found.gravity, body_R_world @ [0.0, 0.0, -9.81], atol=0.6)
    true = np.einsum("ij,nkj->nki", body_R_world, MANY - made.motion.pose(0.0).translation())
    along = true[:, 1] - true[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    assert np.median(np.abs(np.sum(along * found.directions, axis=1))) > 0.99


def test_jumps_of_some_tracks_do_not_move_the_bias():
    rng = np.random.default_rng(0)
    bias = np.array([0.0, 0.0, 0.0, 0.05, -0.04, 0.06])
    made = ideal_tracks(0, hand_held(rng), rate=20.0, duration=1.0, bias=bias)
    lines = planes_of(made)
    for line in lines[:3]:
        line.normals[12:] += rng.normal(scale=0.03, size=3)
        line.normals[12:] /= np.linalg.norm(line.normals[12:], axis=1, keepdims=True)
    samples = made.imu.between(made.times[0], made.times[-1])
    found = gyroscope_bias(samples, made.times.tolist(), lines, 0.1)
    np.testing.assert_allclose(found, bias[3:], atol=0.02)


@pytest.mark.parametrize("gravity", [9.81, 20.0])
@pytest.mark.parametrize("seed", range(4))
def test_where_lines_tell_little_gravity_is_opposite_to_the_specific_force(
    seed, gravity, monkeypatch
):
    monkeypatch.setattr(simulated_imu, "STANDARD_GRAVITY", (0.0, 0.0, -gravity))
    made = ideal_tracks(
        seed,
        hand_held(np.random.default_rng(seed)),
        rate=20.0,
        duration=0.3,
        segments=MANY[:2],
    )
    lines = planes_of(made)
    found = solved(made, lines, np.zeros(3), gravity)
    true = made.motion.rotation(0.0).T @ [0.0, 0.0, -gravity]
    # Within the 5 m/s^2 that a hand may add, and some: not without a direction, not the wrong way.
    assert np.linalg.norm(found.gravity - true) < 6.0
