# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Motion that was measured: a smooth curve through a trajectory from a file."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_lsq_spline
from scipy.spatial.transform import Rotation

from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.core.trajectory import Trajectory
from ruledgraph.evaluation.ground_truth import read_ground_truth
from ruledgraph.simulation.motion import Motion

# Knots of the curve are this far apart, s, or twice the measurement's own interval. EuRoC's flights
# are matched to 0.1 to 1.4 mm and 0.04 to 0.07 degrees RMS.
_KNOTS = 0.1
# A longer silence leaves the curve open, in knot intervals.
_LONGEST_GAP = 4
_DEGREE = 5


class MeasuredMotion(Motion):
    """world_T_body(t) along a measured trajectory, time zero at its first pose.

    One quintic spline with even knots is fitted to positions and unit quaternions by least
    squares; the orientation is the normalised quaternion, so that velocity, acceleration and
    angular velocity are exact derivatives. Knots at least 0.1 s apart, and twice as far as the
    poses, take the noise and the jumps of a tracker out of the accelerations.

    Raises:
        RuledgraphError: for a trajectory that is too short or has a gap.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        """As it was measured."""
        self.epoch = int(trajectory.stamps[0])
        """Stamp of time zero, ns."""
        times = (trajectory.stamps - self.epoch) * 1e-9
        self.start, self.stop = 0.0, float(times[-1])
        spacing = max(_KNOTS, 2.0 * float(np.median(np.diff(times)))) if len(times) > 1 else _KNOTS
        intervals = int(self.stop / spacing)
        if intervals < 2 * _DEGREE:
            raise RuledgraphError(
                f"a trajectory of {self.stop:.2f} s is too short to simulate a motion from"
            )
        longest = int(np.argmax(np.diff(times)))
        if times[longest + 1] - times[longest] > _LONGEST_GAP * spacing:
            raise RuledgraphError(
                f"the trajectory has a gap of {times[longest + 1] - times[longest]:.2f} s after "
                f"{times[longest]:.2f} s; simulate a stretch without one"
            )
        inner = np.linspace(0.0, self.stop, intervals + 1)
        knots = np.concatenate([np.zeros(_DEGREE), inner, np.full(_DEGREE, self.stop)])
        measured = np.hstack([trajectory.positions, trajectory.quaternions])
        try:
            fit = make_lsq_spline(times, measured, knots, k=_DEGREE)
        except (ValueError, np.linalg.LinAlgError) as error:
            raise RuledgraphError(f"no smooth motion fits the trajectory: {error}") from None
        self._curves = fit, fit.derivative(1), fit.derivative(2)

    @classmethod
    def read(
        cls, path: str | Path, start: float = 0.0, duration: float | None = None
    ) -> "MeasuredMotion":
        """From a file that `read_ground_truth` knows: TUM, EuRoC CSV and others.

        Args:
            path: of the file.
            start: skip so many seconds.
            duration: s, by default all.

        Raises:
            RuledgraphError: for a file that cannot be read or a stretch outside it.
        """
        whole = read_ground_truth(path).trajectory
        times = (whole.stamps - whole.stamps[0]) * 1e-9
        stop = np.inf if duration is None else start + duration
        part = (times >= start) & (times <= stop)
        if not part.any():
            raise RuledgraphError(f"{path}: no pose between {start} s and {stop} s")
        return cls(Trajectory(whole.stamps[part], whole.positions[part], whole.quaternions[part]))

    def position(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        return np.asarray(self._curves[0](times)[..., :3])

    def velocity(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        return np.asarray(self._curves[1](times)[..., :3])

    def acceleration(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        return np.asarray(self._curves[2](times)[..., :3])

    def rotation(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        return np.asarray(Rotation.from_quat(self._curves[0](times)[..., 3:]).as_matrix())

    def angular_velocity(self, times: ArrayLike) -> FloatArray:  # noqa: D102
        # 2 Im(conj(q) dq/dt) / |q|^2, with q = (v, w); the length of q cancels.
        q, rate = self._curves[0](times)[..., 3:], self._curves[1](times)[..., 3:]
        v, w = q[..., :3], q[..., 3:]
        spin = w * rate[..., :3] - v * rate[..., 3:] - np.cross(v, rate[..., :3])
        return np.asarray(2.0 * spin / np.sum(q * q, axis=-1, keepdims=True))
