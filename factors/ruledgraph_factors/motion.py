# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Motion between states: the poses of all frames after a state, from the state and the IMU.

A graph keeps a state (pose, velocity, bias) every tenth of a second or so. Frames up to the next
one get no state of their own; their poses follow from the state's by preintegration:

    R_t = R_k Exp(theta_t(b)),    p_t = p_k + v_k t + g t^2 / 2 + R_k dp_t(b),

with (theta, dp, dv)(b) = (theta, dp, dv)(b0) + H (b - b0), the first-order bias correction; H is
the derivative at fixed segments (see `ImuSamples.segments`), as in GTSAM. Where the frames' clock
is not quite that of the IMU, their poses at t + s follow likewise to first order in s: theta and dp
grow by s times their time derivatives, v t + g t^2 / 2 by s (v + g t).

Source: tangent-space preintegration as in GTSAM's `TangentPreintegration`, which is what its
`PreintegratedCombinedMeasurements` runs by default. GTSAM's Python wheel does not expose H, hence
this integrator; the numbers agree with GTSAM's `predict`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from ruledgraph_factors.errors import FactorError
from ruledgraph_factors.imu_samples import ImuSamples, bias_vector
from ruledgraph_factors.integration import integrate_in_numpy
from ruledgraph_factors.kernel import active_kernel, native
from ruledgraph_factors.so3 import exp_and_right_jacobian, hat, inverse_right_jacobian
from ruledgraph_factors.validation import (
    SAME_TIME,
    FloatArray,
    finite_array,
    increasing_times,
    instance,
    number,
)

STANDARD_GRAVITY: tuple[float, float, float] = (0.0, 0.0, -9.81)
"""Default gravity in the world frame (z up), m/s^2."""


class PredictedPoses(NamedTuple):
    """World poses of n frames, with Jacobians.

    Jacobians are of the poses' own right perturbation (rotation, translation), 6 rows, by the
    state's pose (6), velocity (3), bias (6: accelerometer, gyroscope), by gravity (3) and, of a
    motion with a `time_jacobian`, by a shift of the frames in time (1).
    """

    rotation: FloatArray
    """World from body, (n, 3, 3)."""
    position: FloatArray
    """Body origin in the world, (n, 3), m."""
    jacobian: FloatArray | None
    """(n, 6, 18 or 19), None when not asked for."""


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """Preintegrated motion from a state to each of n frames; see the module's equation.

    Build it with `preintegrate_frames` or, for frames that have a pose of their own,
    `FrameMotion.at_rest`.
    """

    elapsed: FloatArray
    """Time since the state, (n,), s."""
    preintegrated: FloatArray
    """(theta, dp, dv) at `bias`, (n, 9), in the state's body frame."""
    bias_jacobian: FloatArray
    """H, its derivative by the bias (accelerometer, gyroscope), (n, 9, 6)."""
    bias: FloatArray
    """b0, the bias integrated with: accelerometer (m/s^2), gyroscope (rad/s), (6,)."""
    time_jacobian: FloatArray | None = None
    """Derivative of (theta, dp) by the frame's time at `bias`, (n, 6); for frames whose clock is
    not quite the IMU's."""

    def __post_init__(self) -> None:
        count = np.size(self.elapsed)
        checked = {
            "elapsed": increasing_times("elapsed", self.elapsed),
            "preintegrated": finite_array("preintegrated", self.preintegrated, (count, 9)),
            "bias_jacobian": finite_array("bias_jacobian", self.bias_jacobian, (count, 9, 6)),
            "bias": finite_array("bias", self.bias, (6,)),
        }
        if self.time_jacobian is not None:
            checked["time_jacobian"] = finite_array("time_jacobian", self.time_jacobian, (count, 6))
        if checked["elapsed"][0] < 0.0:
            raise FactorError(f"elapsed starts at {checked['elapsed'][0]:g} s, before the state")
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def at_rest(cls) -> "FrameMotion":
        """No motion at all: one frame at the state itself."""
        return cls(np.zeros(1), np.zeros((1, 9)), np.zeros((1, 9, 6)), np.zeros(6))

    def __len__(self) -> int:
        return int(self.elapsed.size)

    def select(self, frames: Sequence[int] | slice) -> "FrameMotion":
        """The motion of some of the frames, for a line that is not seen in all of them.

        Raises:
            FactorError: for no frames, or some that there are not.
        """
        if isinstance(frames, slice):
            frames = range(len(self))[frames]
        index = np.asarray(frames)
        if index.size == 0:
            raise FactorError(f"frames: none of the {len(self)} frames is selected")
        if index.dtype.kind not in "iu":
            raise FactorError(f"frames must be indices, not {index.dtype}")
        try:
            return FrameMotion(
                self.elapsed[index],
                self.preintegrated[index],
                self.bias_jacobian[index],
                self.bias,
                None if self.time_jacobian is None else self.time_jacobian[index],
            )
        except IndexError as error:
            raise FactorError(f"frames: {error}") from None

    def require_time(self, time_shift: float) -> None:
        """Raise for a shift of frames that do not know how they would move.

        Raises:
            FactorError: unless `time_shift` is zero or there is a `time_jacobian`.
        """
        if time_shift != 0.0 and self.time_jacobian is None:
            raise FactorError(
                f"time_shift is {time_shift:g} s, but the motion has no time_jacobian: use "
                "preintegrate_frames(..., with_time=True)"
            )

    def corrected(self, bias: FloatArray, time_shift: float = 0.0) -> FloatArray:
        """(theta, dp, dv) at `bias` (6,) and `time_shift` (s) to first order, (n, 9).

        Raises:
            FactorError: for a shift of a motion without `time_jacobian`.
        """
        self.require_time(time_shift)
        found = self.preintegrated + self.bias_jacobian @ (bias - self.bias)
        if self.time_jacobian is not None:
            found[:, :6] += self.time_jacobian * time_shift
        return np.asarray(found)

    def poses(
        self,
        state: gtsam.NavState,
        bias: gtsam.imuBias.ConstantBias,
        gravity: ArrayLike = STANDARD_GRAVITY,
        time_shift: float = 0.0,
    ) -> list[gtsam.Pose3]:
        """world_T_body of every frame, from the state; times body_T_cam, its camera.

        `time_shift` as for `predict`.
        """
        predicted = self.predict(
            state.attitude().matrix(),
            state.position(),
            state.velocity(),
            bias_vector(bias),
            finite_array("gravity", gravity, (3,)),
            want_jacobian=False,
            time_shift=time_shift,
        )
        return [
            gtsam.Pose3(gtsam.Rot3(rotation), position)
            for rotation, position in zip(predicted.rotation, predicted.position, strict=True)
        ]

    def velocities(
        self,
        state: gtsam.NavState,
        bias: gtsam.imuBias.ConstantBias,
        gravity: ArrayLike = STANDARD_GRAVITY,
    ) -> FloatArray:
        """Of the body in the world at every frame, v_t = v + g t + R dv(b), (n, 3), m/s."""
        gained = self.corrected(bias_vector(bias))[:, 6:9] @ state.attitude().matrix().T
        fallen = self.elapsed[:, None] * finite_array("gravity", gravity, (3,))
        return np.asarray(state.velocity() + fallen + gained)

    def predict(
        self,
        rotation: FloatArray,
        position: FloatArray,
        velocity: FloatArray,
        bias: FloatArray,
        gravity: FloatArray,
        want_jacobian: bool = True,
        time_shift: float = 0.0,
    ) -> PredictedPoses:
        """Poses of all frames from the state.

        Args:
            rotation: world_R_body of the state, (3, 3).
            position: of the body in the world, (3,), m.
            velocity: of the body in the world, (3,), m/s.
            bias: accelerometer and gyroscope, (6,).
            gravity: in the world, (3,), m/s^2.
            want_jacobian: whether to fill `PredictedPoses.jacobian`.
            time_shift: how much later than `elapsed` the frames were taken, s; of a motion with a
                `time_jacobian`.

        Raises:
            FactorError: for a shift of a motion without one.
        """
        delta = self.corrected(bias, time_shift)
        t = self.elapsed[:, None]
        by_velocity, by_gravity = t, 0.5 * t * t
        if self.time_jacobian is not None:
            by_velocity, by_gravity = t + time_shift, by_gravity + t * time_shift
        delta_rotation, right_jacobian = exp_and_right_jacobian(delta[:, :3])
        delta_position = delta[:, 3:6]
        rotations = rotation @ delta_rotation
        positions = position + velocity * by_velocity + gravity * by_gravity
        positions = positions + delta_position @ rotation.T
        if not want_jacobian:
            return PredictedPoses(rotations, positions, None)

        frame_R_state = delta_rotation.transpose(0, 2, 1)
        frame_R_world = rotations.transpose(0, 2, 1)
        jacobian = np.zeros((len(self), 6, 18 if self.time_jacobian is None else 19))
        jacobian[:, :3, 0:3] = frame_R_state
        jacobian[:, 3:, 0:3] = -frame_R_state @ hat(delta_position)
        jacobian[:, 3:, 3:6] = frame_R_state
        jacobian[:, 3:, 6:9] = frame_R_world * by_velocity[..., None]
        jacobian[:, :3, 9:15] = right_jacobian @ self.bias_jacobian[:, :3]
        jacobian[:, 3:, 9:15] = frame_R_state @ self.bias_jacobian[:, 3:6]
        jacobian[:, 3:, 15:18] = frame_R_world * by_gravity[..., None]
        if self.time_jacobian is not None:
            turning, moving = self.time_jacobian[:, :3], self.time_jacobian[:, 3:]
            jacobian[:, :3, 18] = np.einsum("nij,nj->ni", right_jacobian, turning)
            moving = velocity + gravity * t + moving @ rotation.T
            jacobian[:, 3:, 18] = np.einsum("nij,nj->ni", frame_R_world, moving)
        return PredictedPoses(rotations, positions, jacobian)


def preintegrate_frames(
    imu: ImuSamples,
    state_time: float,
    frame_times: ArrayLike,
    bias: gtsam.imuBias.ConstantBias | None = None,
    with_time: bool = False,
) -> FrameMotion:
    """Preintegrate the IMU from a state to every frame after it.

    Args:
        imu: samples that cover [state_time, frame_times[-1]].
        state_time: time of the state, s.
        frame_times: strictly increasing, the first at or after the state, (n,), s.
        bias: where to linearise, by default zero; use the current estimate.
        with_time: whether to fill `FrameMotion.time_jacobian`.

    Raises:
        FactorError: for frames before the state, times not increasing, samples that do not cover
            the frames, or a turn of more than pi, beyond which rotation vectors (and GTSAM's
            preintegration) are not unique.
    """
    instance("imu", imu, ImuSamples)
    state_time = number("state_time", state_time)
    times = increasing_times("frame_times", frame_times)
    if times[0] < state_time - SAME_TIME:
        raise FactorError(
            f"frame_times[0] = {times[0]:.9f} s lies before the state at {state_time:.9f} s"
        )
    times = np.maximum(times, state_time)
    b = bias_vector(bias)
    breaks, force, rate = imu._segment_arrays(state_time, float(times[-1]), times, b)
    deltas, jacobians = np.empty((breaks.size, 9)), np.empty((breaks.size, 9, 6))
    integrate = native.integrate if active_kernel() == "native" else integrate_in_numpy
    last = integrate(force - b[:3], rate - b[3:], np.diff(breaks), deltas, jacobians)
    if deltas[last, :3] @ deltas[last, :3] > np.pi**2:
        raise FactorError(
            f"frame_times: the body turns by more than half a turn from {state_time:.3f} s "
            f"to {breaks[last]:.3f} s; put a state in between"
        )
    at_frames = np.searchsorted(breaks, np.minimum(times, breaks[-1]))
    delta, by_time = deltas[at_frames], None
    if with_time:
        # d theta / dt = Jr(theta)^-1 w, d dp / dt = dv
        at = [np.interp(times, imu.times, column) for column in imu.gyroscope.T]
        rate = np.stack(at, axis=1) - b[3:]
        turning = np.einsum("nij,nj->ni", inverse_right_jacobian(delta[:, :3]), rate)
        by_time = np.hstack([turning, delta[:, 6:]])
    return FrameMotion(times - state_time, delta, jacobians[at_frames], b, by_time)
