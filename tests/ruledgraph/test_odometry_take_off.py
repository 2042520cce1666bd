# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""A body that sets off from rest in a large hall: for half a second the image hardly moves, and the
IMU, with its mean taken off, is that of a rest. It must not be taken for one that stays.
"""

import numpy as np
import pytest

from ruledgraph.core.arrays import FloatArray
from ruledgraph.simulation import simulate
from ruledgraph.simulation.motion import Motion
from ruledgraph.simulation.motions import WORLD_R_CAM
from ruledgraph.simulation.scenes import make_scene
from small_runs import run
from small_simulation import SMALL

SETS_OFF = 2.05
LENGTH = 1.0
STOP = 3.5


class TakeOff(Motion):
    """At rest, then a constant acceleration for a second, m/s^2, in the world."""

    start, stop = 0.0, STOP

    def __init__(self, acceleration: FloatArray) -> None:
        self._acceleration = acceleration

    def position(self, times) -> FloatArray:
        moving, after = self._phases(times)
        return (0.5 * moving**2 + LENGTH * after)[..., None] * self._acceleration

    def velocity(self, times) -> FloatArray:
        return self._phases(times)[0][..., None] * self._acceleration

    def acceleration(self, times) -> FloatArray:
        moving, after = self._phases(times)
        return ((moving > 0.0) & (after == 0.0))[..., None] * self._acceleration

    def rotation(self, times) -> FloatArray:
        body = WORLD_R_CAM @ SMALL.body_T_cam.rotation().matrix().T
        return np.broadcast_to(body, (*np.shape(times), 3, 3)).copy()

    def angular_velocity(self, times) -> FloatArray:
        return np.zeros((*np.shape(times), 3))

    @staticmethod
    def _phases(times) -> tuple[FloatArray, FloatArray]:
        since = np.asarray(times, dtype=float) - SETS_OFF
        return np.clip(since, 0.0, LENGTH), np.maximum(since - LENGTH, 0.0)


@pytest.mark.parametrize("acceleration", [(0.5, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.6, 0.0)])
def test_a_take_off_in_a_hall_is_followed(acceleration):
    simulation = simulate(
        make_scene("hall", 0), TakeOff(np.array(acceleration)), calibration=SMALL, rate=30.0, seed=0
    )
    odometry, live, smoothed = run(simulation.stream(), simulation.calibration)
    start = simulation.truth(np.array([live[0].stamp]))
    # From the truth's world to the estimate's; they differ by the heading.
    R0 = live[0].world_T_body.rotation().matrix() @ start.rotation[0].T
    for estimates in (live, smoothed):
        true = simulation.truth(np.array([e.stamp for e in estimates]))
        for estimate, position, velocity in zip(
            estimates, true.position, true.velocity, strict=True
        ):
            R = estimate.world_T_body.rotation().matrix()
            error = estimate.world_T_body.translation() - R0 @ (position - start.position[0])
            assert np.linalg.norm(error) < 0.03
            of_position = R @ estimate.covariances[0][3:, 3:] @ R.T
            # Three sigmas of a Gaussian in three dimensions, and what the alignment is off by.
            assert error @ np.linalg.solve(of_position + 4e-6 * np.eye(3), error) < 14.2
            off = estimate.velocity - R0 @ velocity
            of_velocity = estimate.covariances[1] + 1e-4 * np.eye(3)
            assert off @ np.linalg.solve(of_velocity, off) < 14.2
    assert "still" not in {e.status for e in live if e.time - simulation.epoch * 1e-9 > 2.5}
    assert odometry.warnings == []
