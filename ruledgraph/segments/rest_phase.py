# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the body rests, as a segment goes on, and what need not be done then."""

import math
from typing import Literal

import gtsam
import numpy as np

from ruledgraph.backend.sliding_window import Window
from ruledgraph.core.config import Config
from ruledgraph.core.estimates import Covariances
from ruledgraph.integrity.rest import RestDetector
from ruledgraph.integrity.unmoved_lines import log_odds_of_rest
from ruledgraph.synchronization.frame_history import TIME_TOLERANCE


class RestPhase:
    """Whether the body rests at the newest state, and at the frames since.

    During a rest:

    - Neither the image nor the IMU moves: the rest goes on.
    - The image moves: the rest ends.
    - The IMU alone moves: undecided. The body sets off, and the image will show it, or all that is
      in view accelerates with it, as in a lift. When the IMU has come to rest again the motions of
      the lines decide between the two by a sequential test (`log_odds_of_rest`). Where they have
      not done so after `rest.max_undecided_time` the body has moved.

    Before a rest is known, lines may not move while the IMU does: until one of them changes, the
    body may be where it was when that began (`stayed_at`).

    Args:
        detector: what image and IMU show.
        focal_length: px.
        config: all settings.
        rests: whether it begins with a rest.
    """

    def __init__(
        self, detector: RestDetector, focal_length: float, config: Config, rests: bool = False
    ) -> None:
        self._detector = detector
        self._focal_length = focal_length
        self._config = config
        self.interval = min(config.window.lag / 2.0, config.rest.solve_interval)
        """At rest new lines are looked for, and the window is solved, this often, s."""
        self._longest_undecided = min(config.window.lag / 2.0, config.rest.max_undecided_time)
        self.of_state = rests
        """Whether the body has rested until the newest state, and for some time before."""
        self.goes_on = rests
        """Whether it has until the latest frame, as far as that is known."""
        self.is_undecided = False
        """Whether that is not known yet, after a rest until the newest state."""
        self._is_denied = False
        self.stayed_at: gtsam.NavState | None = None
        """Where the body was when lines began to say that it rests, and the IMU that it moves; None
        where they do not."""

    @property
    def is_held(self) -> bool:
        """Whether the body rests at the latest frame, whose state is the newest one."""
        return self.of_state and self.goes_on

    def update(
        self,
        window: Window,
        time: float,
        state: gtsam.NavState,
        body_T_cam: gtsam.Pose3,
        last: bool = False,
    ) -> None:
        """Look at the frame at a time (s), with its state by the IMU; the last one decides."""
        still = self._detector.is_still(time, window.rests_since)
        self._is_denied |= not still
        self.is_undecided = False
        if not self.of_state:
            self._begin(window, state, body_T_cam, still)
            return
        self.stayed_at = None
        if not self._is_denied:
            self.goes_on = True
        elif not self._detector.image_is_unmoved(window.rests_since):
            self.goes_on = False
        else:
            says = self._lines_say(window, state, body_T_cam)
            ends = last or time - window.newest.time > self._longest_undecided - TIME_TOLERANCE
            self.goes_on = says == "rest" and (still or ends)
            self.is_undecided = not (self.goes_on or ends or says == "motion")

    def _begin(
        self, window: Window, state: gtsam.NavState, body_T_cam: gtsam.Pose3, still: bool
    ) -> None:
        """Whether a rest begins, and whether the IMU contradicts one."""
        newest = window.newest
        if self._detector.is_noise(state.position() - newest.state.position()):
            # That the image shows no motion is no news where the IMU shows none either.
            self.goes_on, self.stayed_at = still, None
            return
        says = self._lines_say(window, state, body_T_cam)
        self.goes_on = still and says == "rest"
        if says == "motion":
            self.stayed_at = None
        elif says == "rest" and self._detector.image_is_unmoved(window.rests_since):
            self.stayed_at = self.stayed_at or newest.state

    def begin_state(self) -> bool:
        """Begin a state at the latest frame. Returns whether the body has rested until then."""
        self.of_state, self.is_undecided, self._is_denied = self.goes_on, False, False
        return self.of_state

    def _lines_say(
        self, window: Window, state: gtsam.NavState, body_T_cam: gtsam.Pose3
    ) -> Literal["rest", "motion", "nothing"]:
        """Whether the body has stayed or moved as the IMU says, since the newest state."""
        world_T_cam = state.pose().compose(body_T_cam)
        before = window.newest.state.pose().compose(body_T_cam)
        moved_by = world_T_cam.rotation().unrotate(world_T_cam.translation() - before.translation())
        odds = log_odds_of_rest(
            *self._detector.lines_moved(window.rests_since),
            self._focal_length * moved_by,
            window.line_manager.usual_distance(),
            self._config.lines.prior_distance_factor,
        )
        needed = -math.log1p(-self._config.rest.confidence)
        if abs(odds) < needed:
            return "nothing"
        return "rest" if odds > 0.0 else "motion"

    def held(self, state: gtsam.NavState, window: Window) -> gtsam.NavState:
        """A state since the newest one, without the motion by the IMU while the image is still:
        where lines are to be looked for, and how the rows of their images are to be read.
        """
        if self.is_held or self.is_undecided:
            at = window.newest.state
            return gtsam.NavState(state.attitude(), at.position(), at.velocity())
        return state

    def is_idle(self, window: Window, time: float, state: gtsam.NavState) -> bool:
        """Whether there is nothing to solve for at a time (s) of rest, with a state by the IMU."""
        recent = time - window.solved < self.interval - TIME_TOLERANCE
        moved = state.position() - window.newest.state.position()
        return recent and self._detector.is_unmoved(window.solved, moved)

    def estimate(
        self, window: Window, state: gtsam.NavState, covariances: Covariances
    ) -> tuple[gtsam.NavState, Covariances]:
        """State and covariances of the latest frame, of what the IMU makes of the newest state.

        At rest the state is the newest one; while it is undecided whether the rest goes on, or
        lines deny a motion before a rest is known, it is the IMU's. The covariances hold for both,

            P + x x^T,    x = Log(T^-1 T_rest) of the pose, -v of the velocity,

        where P is that of the state by the IMU: with no less than that of the newest state it is no
        less than the covariance about the reported state, whichever of the two is right.
        """
        at = window.newest.state if self.is_held or self.is_undecided else self.stayed_at
        if at is None:
            return state, covariances
        of_pose, of_velocity, of_bias = covariances
        x, v = state.pose().localCoordinates(at.pose()), state.velocity() - at.velocity()
        both = of_pose + np.outer(x, x), of_velocity + np.outer(v, v), of_bias
        return (at if self.is_held else state), both
