# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines, velocity and gravity from a first window, for a start in motion.

`closed_form` solves it linearly: the gyroscope gives the rotations, the planes that a line spans
with the camera on its way its direction, and the doubly integrated accelerometer makes the rest
metric. Lines so far that their planes do not turn stay out of it. Levenberg-Marquardt on the
geometric residual then takes out the bias of the linear solution, with all lines and the
gyroscope's bias.

It is degenerate, and `DegenerateWindowError` says which of these it is, when

- fewer than two lines are given, or all are parallel: motion along them is not seen;
- the planes of fewer than two lines turn: a camera at rest, one that only rotates, or one that
  moves within those planes;
- the acceleration hardly changes: one that is constant in the start frame looks like a motion of
  any scale;
- velocity and gravity are too uncertain for another reason;
- what comes out does not explain the points, has lines behind the camera, or a gravity that is not
  the Earth's.

The limits are those of a camera carried or flown among things metres away.

Source: the paper's constraint (Zhu, Burner, Aloimonos, arXiv 2512.00327, Eq. 8 to 10), in moments.
"""

from collections.abc import Sequence

import gtsam
import numpy as np

from ruledgraph_factors.closed_form import closed_form
from ruledgraph_factors.errors import DegenerateWindowError
from ruledgraph_factors.line import LineChart
from ruledgraph_factors.motion import FrameMotion
from ruledgraph_factors.ruling import line_from_ruling
from ruledgraph_factors.validation import instance, pose, positive_number
from ruledgraph_factors.window_rays import LineTrack, TrackRays, known_motion
from ruledgraph_factors.window_refinement import WindowSolution, refine

# Directions within this angle (rad, two degrees) count as parallel.
_PARALLEL = 0.035
# White noise of a consumer IMU, m/s^2/sqrt(Hz). Doubly integrated over T seconds, what a parabola
# leaves of it is 0.036 T^1.5 times as much; the acceleration has to show this many times stronger.
_IMU_NOISE = 2e-3
_MIN_EXCITATION = 30.0
# Where a line whose planes do not turn starts, 1/m.
_FAR = 0.01


def solve_first_window(
    motion: FrameMotion,
    tracks: Sequence[LineTrack],
    body_T_cam: gtsam.Pose3 | None = None,
    sigma: float = 1e-3,
) -> WindowSolution:
    """Lines, velocity and gravity of a first window by linear least squares, see the module's text.

    Args:
        motion: from the window's start to all its frames, integrated with the gyroscope's bias
            known to about 0.02 rad/s. An accelerometer's bias ends up in gravity.
        tracks: of two or more lines.
        body_T_cam: camera pose in the body frame, by default identity.
        sigma: standard deviation expected of an edge point across the true ruling, blur and
            calibration included, in normalised image units; by default half a pixel at a focal
            length of 500 px.

    Raises:
        DegenerateWindowError: when the window does not determine them, with the reason.
        FactorError: for input of the wrong form.
    """
    instance("motion", motion, FrameMotion)
    body_T_cam = gtsam.Pose3() if body_T_cam is None else pose("body_T_cam", body_T_cam)
    positive_number("sigma", sigma)
    if len(tracks) < 2:
        raise DegenerateWindowError(
            f"{len(tracks)} line(s) in the window: motion along a line is not seen, "
            "two that are not parallel are needed"
        )
    sights = [TrackRays(i, track, motion, body_T_cam, sigma) for i, track in enumerate(tracks)]
    turning = [sight for sight in sights if sight.turns]
    _require_two_directions(turning)
    _require_excitation(motion, body_T_cam)
    found = closed_form(motion, [sight.planes for sight in turning], body_T_cam.translation())
    velocity, gravity = found.velocity, found.gravity
    charts = []
    for sight in sights:
        if sight.turns:
            line = turning.index(sight)
            moment, direction = found.moments[line], found.directions[line]
            charts.append(LineChart.from_plucker(body_T_cam, moment, direction))
        else:
            centre = sight.centres(velocity, gravity)[0]
            start_T_cam = gtsam.Pose3(gtsam.Rot3(sight.start_R_cam[0]), centre)
            charts.append(line_from_ruling(start_T_cam, sight.points[0], _FAR))
    return refine(sights, charts, motion, body_T_cam, velocity, gravity, sigma)


def _require_two_directions(turning: Sequence[TrackRays]) -> None:
    if len(turning) < 2:
        raise DegenerateWindowError(
            f"the planes of {len(turning)} line(s) turn, two are needed: the camera rests, only "
            "rotates, or moves within the planes of its lines"
        )
    directions = np.array([sight.direction for sight in turning])
    if np.linalg.svd(directions, compute_uv=False)[1] < _PARALLEL * np.sqrt(len(turning)):
        raise DegenerateWindowError("all lines are parallel: motion along them is not seen")


def _require_excitation(motion: FrameMotion, body_T_cam: gtsam.Pose3) -> None:
    """Scale comes from what velocity, gravity and the lines' place cannot absorb of G(t)."""
    t = motion.elapsed - motion.elapsed[0]
    _, known_centres = known_motion(motion, body_T_cam)
    parabolas = np.column_stack([np.ones_like(t), t, t * t])
    rest = known_centres - parabolas @ np.linalg.lstsq(parabolas, known_centres, rcond=None)[0]
    excitation = float(np.sqrt(np.mean(np.sum(rest * rest, axis=1))))
    least = _MIN_EXCITATION * 0.036 * _IMU_NOISE * float(t[-1]) ** 1.5
    if excitation <= least:
        raise DegenerateWindowError(
            f"the acceleration hardly changes: it moves the camera by {1e3 * excitation:.2g} mm "
            f"off a parabola, and {1e3 * least:.2g} mm are needed for the scale"
        )
