# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np
import pytest

from ideal_tracks import MANY, ideal_tracks
from ruledgraph.initialization.closed_form import Planes, closed_form, gyroscope_bias
from simulated_window import BODY_T_CAM, FOCAL_LENGTH, hand_held


@pytest.mark.parametrize("seed", range(5))
def test_bias_velocity_gravity_and_lines_without_initial_values(seed):
    rng = np.random.default_rng(seed)
    bias = np.concatenate([np.zeros(3), rng.normal(scale=0.06, size=3)])
    made = ideal_tracks(seed, hand_held(rng), rate=20.0, duration=1.0, bias=bias)
    body_R_cam, arm = BODY_T_CAM.rotation().matrix(), BODY_T_CAM.translation()
    frames, sigma = list(range(len(made.times))), 0.5 / FOCAL_LENGTH
    lines = [Planes.of(frames, list(t.sightings), body_R_cam, sigma) for t in made.tracks]
    samples = made.imu.between(made.times[0], made.times[-1])
    found_bias = gyroscope_bias(samples, made.times.tolist(), lines, 0.1)
    # A second of 20 frames of 12 lines at half a pixel.
    np.testing.assert_allclose(found_bias, bias[3:], atol=0.01)
    found = closed_form(samples, made.times.tolist(), lines, found_bias, arm)
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
    frames, sigma = list(range(len(made.times))), 0.5 / FOCAL_LENGTH
    body_R_cam = BODY_T_CAM.rotation().matrix()
    lines = [Planes.of(frames, list(t.sightings), body_R_cam, sigma) for t in made.tracks]
    for line in lines[:3]:
        line.normals[12:] += rng.normal(scale=0.03, size=3)
        line.normals[12:] /= np.linalg.norm(line.normals[12:], axis=1, keepdims=True)
    samples = made.imu.between(made.times[0], made.times[-1])
    found = gyroscope_bias(samples, made.times.tolist(), lines, 0.1)
    np.testing.assert_allclose(found, bias[3:], atol=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_where_lines_tell_little_gravity_is_opposite_to_the_specific_force(seed):
    made = ideal_tracks(
        seed,
        hand_held(np.random.default_rng(seed)),
        rate=20.0,
        duration=0.3,
        segments=MANY[:2],
    )
    body_R_cam, arm = BODY_T_CAM.rotation().matrix(), BODY_T_CAM.translation()
    frames, sigma = list(range(len(made.times))), 0.5 / FOCAL_LENGTH
    lines = [Planes.of(frames, list(t.sightings), body_R_cam, sigma) for t in made.tracks]
    samples = made.imu.between(made.times[0], made.times[-1])
    found = closed_form(samples, made.times.tolist(), lines, np.zeros(3), arm)
    true = made.motion.rotation(0.0).T @ [0.0, 0.0, -9.81]
    # Within the 5 m/s^2 that a hand may add, and some: not without a direction, not the wrong way.
    assert np.linalg.norm(found.gravity - true) < 6.0
