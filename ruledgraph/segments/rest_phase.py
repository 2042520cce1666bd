# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the body rests, as a segment goes on, and what need not be done then."""

import gtsam
import numpy as np

from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Covariances
from ruledgraph.imu.frame_history import EARLY
from ruledgraph.integrity.rest import RestDetector


class RestPhase:
    """Of the newest state, and of the frames since.

    A rest ends where the image moves. Where the IMU alone says so it is open for a while: the body
    sets off, and the image will show it, or an acceleration acts on all that is in view as well, as
    in a lift.

    Args:
        detector: what image and IMU show.
        config: all settings.
    """

    def __init__(self, detector: RestDetector, config: Config) -> None:
        self._detector = detector
        self.interval = min(config.window.lag / 2.0, config.rest.solve_interval)
        """At rest new lines are looked for, and the window is solved, this often, s; so long it may
        be open whether a rest goes on."""
        self.of_state = False
        """Whether the body has rested until the newest state, and for some time before."""
        self.goes_on = False
        """Whether it has until the latest frame, as far as that is known."""
        self.is_open = False
        """Whether that is open, after a rest until the newest state."""

    @property
    def _is_held(self) -> bool:
        """Whether the state of the latest frame is the newest one."""
        return self.of_state and self.goes_on

    def look(self, window: Window, time: float) -> None:
        """Look at the latest frame, at a time, s."""
        self.goes_on = self._detector.is_still(time, window.rests_since)
        self.is_open = (
            self.of_state
            and not self.goes_on
            and time - window.newest.time < self.interval - EARLY
            and self._detector.image_is_unmoved(window.rests_since)
        )

    def held(self, pose: gtsam.Pose3, window: Window) -> gtsam.Pose3:
        """A pose since the newest state, without the way by the IMU while the image has not moved:
        where lines are to be looked for.
        """
        if self._is_held or self.is_open:
            return gtsam.Pose3(pose.rotation(), window.newest.state.position())
        return pose

    def is_idle(self, window: Window, time: float, moved: FloatArray) -> bool:
        """Whether there is nothing to solve for at a time (s) of rest, `moved` (3,), m, since the
        newest state by the IMU.
        """
        recent = time - window.solved < self.interval - EARLY
        return recent and self._detector.is_unmoved(window.solved, moved)

    def estimate(
        self, window: Window, state: gtsam.NavState, covariances: Covariances
    ) -> tuple[gtsam.NavState, Covariances]:
        """State and covariances of the latest frame, of what the IMU makes of the newest state.

        At rest they are those of the newest state. While it is open whether the rest goes on the
        covariances hold in both cases:

            P + x x^T,    x = Log(T^-1 T_rest) of the pose, -v of the velocity,

        is no less than the covariance, about this state, of either case and of any mixture.
        """
        newest = window.newest
        if self._is_held:
            return newest.state, newest.covariances
        if not self.is_open:
            return state, covariances
        of_pose, of_velocity, of_bias = covariances
        x, v = state.pose().localCoordinates(newest.state.pose()), state.velocity()
        return state, (of_pose + np.outer(x, x), of_velocity + np.outer(v, v), of_bias)
