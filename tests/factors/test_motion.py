# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Preintegrated frames against GTSAM's own predict, numerical derivatives and exact motion."""

import gtsam
import numpy as np
import pytest

from numerics import derivative, relative_error
from ruledgraph.calibration.imu_noise import D435I_LIKE
from ruledgraph.simulation import SplineMotion, simulate_imu
from ruledgraph_factors import STANDARD_GRAVITY, FactorError, ImuSamples, preintegrate_frames

GRAVITY = np.array(STANDARD_GRAVITY)
BIAS = gtsam.imuBias.ConstantBias(np.array([0.1, -0.2, 0.05]), np.array([0.01, 0.03, -0.08]))
# The step for which agreement with GTSAM's first-order correction is asked.
BIAS_STEP = np.concatenate([np.full(3, 0.3), np.full(3, -0.05)])


def shaken_motion(seed: int) -> SplineMotion:
    rng = np.random.default_rng(seed)
    times = np.linspace(0.0, 2.0, 15)
    return SplineMotion(
        times,
        np.cumsum(rng.normal(size=(15, 3)) * 0.1, axis=0),
        np.cumsum(rng.normal(size=(15, 3)) * 0.15, axis=0),
    )


def state_of(motion: SplineMotion, time: float) -> tuple[gtsam.Pose3, np.ndarray]:
    return motion.pose(time), motion.velocity(time)


def gtsam_predictions(
    imu: ImuSamples, node: float, frames: np.ndarray, state: gtsam.NavState, bias
) -> list[gtsam.NavState]:
    params = D435I_LIKE.preintegration_params()
    preintegrated = gtsam.PreintegratedCombinedMeasurements(params, BIAS)
    result, start = [], node
    for stop in frames:
        for segment in imu.segments(start, stop, bias=BIAS):
            preintegrated.integrateMeasurement(*segment)
        start = stop
        result.append(preintegrated.predict(state, bias))
    return result


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("rate", [97.0, 200.0, 1000.0])
@pytest.mark.parametrize("step", [np.zeros(6), BIAS_STEP], ids=["at_bias", "bias_step"])
def test_poses_agree_with_gtsam_predict(seed: int, rate: float, step: np.ndarray) -> None:
    motion = shaken_motion(seed)
    imu = simulate_imu(motion, rate, D435I_LIKE, np.random.default_rng(seed), BIAS.vector())
    node, frames = 0.4013, 0.4013 + np.arange(10) / 90.0
    pose, velocity = state_of(motion, node)
    bias = BIAS.vector() + step
    predicted = preintegrate_frames(imu.samples, node, frames, BIAS).predict(
        pose.rotation().matrix(), pose.translation(), velocity, bias, GRAVITY
    )
    expected = gtsam_predictions(
        imu.samples,
        node,
        frames,
        gtsam.NavState(pose, velocity),
        gtsam.imuBias.ConstantBias(bias[:3], bias[3:]),
    )
    for i, state in enumerate(expected):
        np.testing.assert_allclose(predicted.position[i], state.position(), atol=1e-9)
        np.testing.assert_allclose(predicted.rotation[i], state.attitude().matrix(), atol=1e-9)


def test_poses_and_velocities_are_those_of_gtsams_prediction() -> None:
    shaken = shaken_motion(0)
    imu = simulate_imu(shaken, 200.0, None, np.random.default_rng(0)).samples
    frames = 0.4 + np.arange(1, 4) * 0.03
    state = gtsam.NavState(*state_of(shaken, 0.4))
    motion = preintegrate_frames(imu, 0.4, frames, BIAS)
    expected = gtsam_predictions(imu, 0.4, frames, state, BIAS)
    for pose, of_gtsam in zip(motion.poses(state, BIAS), expected, strict=True):
        assert pose.equals(of_gtsam.pose(), 1e-9)
    for velocity, of_gtsam in zip(motion.velocities(state, BIAS), expected, strict=True):
        np.testing.assert_allclose(velocity, of_gtsam.velocity(), atol=1e-9)


def test_times_that_differ_by_rounding_are_the_same() -> None:
    """0.1 * 3 is not 9 / 30 in float64; a Unix time has steps of a quarter microsecond."""
    imu = ImuSamples(np.arange(41) / 100.0, np.zeros((41, 3)), np.zeros((41, 3)))
    assert 9.0 / 30.0 < 0.1 * 3.0
    motion = preintegrate_frames(imu, 0.1 * 3, np.arange(9, 12) / 30.0)
    assert motion.elapsed[0] == 0.0
    assert sum(s.dt for s in imu.segments(0.3, 0.4 + 1e-12)) == pytest.approx(0.1)


def test_plain_samples_held_constant_agree_with_gtsam_without_our_segments() -> None:
    """Without rotation the segments are the samples themselves, integrated as anyone would."""
    times = np.arange(21) * 0.005
    force = np.tile([0.3, -0.2, 9.9], (21, 1))
    imu = ImuSamples(times, np.zeros((21, 3)), force)
    preintegrated = gtsam.PreintegratedCombinedMeasurements(
        D435I_LIKE.preintegration_params(), gtsam.imuBias.ConstantBias()
    )
    for _ in range(20):
        preintegrated.integrateMeasurement(force[0], np.zeros(3), 0.005)
    moved = preintegrate_frames(imu, 0.0, times[20:])
    np.testing.assert_allclose(moved.preintegrated[0, 3:6], preintegrated.deltaPij(), atol=1e-12)


def test_jacobian_of_predicted_poses() -> None:
    for seed in range(20):
        assert_jacobian_of_prediction(seed)


def assert_jacobian_of_prediction(seed: int) -> None:
    rng = np.random.default_rng(seed)
    motion = shaken_motion(seed)
    imu = simulate_imu(motion, 200.0, None, rng)
    frames = 0.5 + np.arange(4) * 0.05
    frame_motion = preintegrate_frames(imu.samples, 0.5, frames, BIAS, with_time=True)
    pose, velocity = state_of(motion, 0.5)
    bias = BIAS.vector() + rng.normal(size=6) * 0.05

    def predict(tangent: np.ndarray, want_jacobian: bool = False):
        moved = pose.retract(tangent[:6])
        return frame_motion.predict(
            moved.rotation().matrix(),
            moved.translation(),
            velocity + tangent[6:9],
            bias + tangent[9:15],
            GRAVITY + tangent[15:18],
            want_jacobian=want_jacobian,
            time_shift=0.004 + tangent[18],
        )

    nominal = predict(np.zeros(19), want_jacobian=True)
    assert predict(np.zeros(19)).jacobian is None

    def local(tangent: np.ndarray) -> np.ndarray:
        moved = predict(tangent)
        return np.stack(
            [
                np.append(
                    gtsam.Rot3.Logmap(gtsam.Rot3(r0.T @ r)),
                    r0.T @ (p - p0),
                )
                for r0, p0, r, p in zip(
                    nominal.rotation, nominal.position, moved.rotation, moved.position, strict=True
                )
            ]
        )

    numeric = derivative(local, np.zeros(19), 1e-4)
    assert nominal.jacobian is not None
    for columns in (slice(0, 6), slice(6, 9), slice(9, 15), slice(15, 18), slice(18, 19)):
        assert relative_error(nominal.jacobian[..., columns], numeric[..., columns]) < 1e-7


@pytest.mark.parametrize("seed", range(5))
def test_time_jacobian_is_the_derivative_of_integrating_to_shifted_frames(seed: int) -> None:
    """Within a pair of samples, where the IMU's signals have no kinks. With its steps of 2.5 ms the
    integrator's derivative is off by the jerk, some 200 m/s^3, times their square.
    """
    motion = shaken_motion(seed)
    imu = simulate_imu(motion, 200.0, None, np.random.default_rng(seed)).samples
    frames = 0.3025 + np.arange(4) * 0.05

    def to_frames(shift: float) -> np.ndarray:
        moved = preintegrate_frames(imu, 0.3, frames + shift, BIAS).preintegrated[:, :6]
        return np.asarray(moved)

    step = 5e-4
    numeric = (to_frames(step) - to_frames(-step)) / (2.0 * step)
    by_time = preintegrate_frames(imu, 0.3, frames, BIAS, with_time=True).time_jacobian
    assert by_time is not None
    np.testing.assert_allclose(by_time, numeric, rtol=1e-4, atol=2e-3)


@pytest.mark.parametrize("seed", range(5))
def test_frames_shifted_in_time_are_right_to_first_order(seed: int) -> None:
    """What is left of a shift is of second order: a quarter at half of it."""
    motion = shaken_motion(seed)
    imu = simulate_imu(motion, 200.0, None, np.random.default_rng(seed)).samples
    frames = 0.5 + np.arange(1, 5) * 0.05
    timed = preintegrate_frames(imu, 0.5, frames, BIAS, with_time=True)
    state = gtsam.NavState(*state_of(motion, 0.5))

    def left(shift: float) -> float:
        exact = preintegrate_frames(imu, 0.5, frames + shift, BIAS).poses(state, BIAS)
        shifted = timed.poses(state, BIAS, time_shift=shift)
        return max(
            float(np.abs(a.localCoordinates(b)).max()) for a, b in zip(exact, shifted, strict=True)
        )

    assert left(0.0) < 1e-15
    assert left(0.02) / left(0.01) == pytest.approx(4.0, rel=0.1)
    # Half of some 40 rad/s^2 for 5 ms.
    assert left(0.005) < 5e-4


@pytest.mark.parametrize("seed", range(5))
def test_bias_jacobian_is_the_derivative_of_the_integration(seed: int) -> None:
    """Integrating the same segments anew at every bias, with GTSAM as the integrator."""
    motion = shaken_motion(seed)
    imu = simulate_imu(motion, 200.0, None, np.random.default_rng(seed)).samples
    segments = list(imu.segments(0.3, 0.8, bias=BIAS))
    params = D435I_LIKE.preintegration_params()

    def integrate(bias: np.ndarray) -> np.ndarray:
        preintegrated = gtsam.PreintegratedCombinedMeasurements(
            params, gtsam.imuBias.ConstantBias(bias[:3], bias[3:])
        )
        for segment in segments:
            preintegrated.integrateMeasurement(*segment)
        return np.concatenate(
            [
                gtsam.Rot3.Logmap(preintegrated.deltaRij()),
                preintegrated.deltaPij(),
                preintegrated.deltaVij(),
            ]
        )

    analytic = preintegrate_frames(imu, 0.3, [0.8], BIAS).bias_jacobian[0]
    numeric = derivative(integrate, BIAS.vector(), 1e-3)
    assert relative_error(analytic, numeric) < 1e-7


def test_exact_motion_is_reproduced() -> None:
    """1 s of a shaken motion (up to 3 rad/s) at 400 Hz within 2 mm and 1 mrad.

    The same samples applied with the orientation at the start of each step, as without the
    half-step turn of `ImuSamples.segments`, are off by more than ten times that.
    """
    motion = shaken_motion(3)
    imu = simulate_imu(motion, 400.0, None, np.random.default_rng(0)).samples
    pose, velocity = state_of(motion, 0.5)
    turned = preintegrate_frames(imu, 0.5, [1.5])
    predicted = turned.predict(
        pose.rotation().matrix(), pose.translation(), velocity, np.zeros(6), GRAVITY
    )
    position_error = np.linalg.norm(predicted.position[0] - motion.position(1.5))
    rotation_error = gtsam.Rot3.Logmap(gtsam.Rot3(predicted.rotation[0].T @ motion.rotation(1.5)))
    assert position_error < 2e-3
    assert np.linalg.norm(rotation_error) < 1e-3

    plain = gtsam.PreintegratedCombinedMeasurements(
        D435I_LIKE.preintegration_params(), gtsam.imuBias.ConstantBias()
    )
    inside = (imu.times > 0.5) & (imu.times <= 1.5 + 1e-9)
    for force, rate in zip(imu.accelerometer[inside], imu.gyroscope[inside], strict=True):
        plain.integrateMeasurement(force, rate, 1.0 / 400.0)
    naive = plain.predict(gtsam.NavState(pose, velocity), gtsam.imuBias.ConstantBias())
    assert np.linalg.norm(naive.position() - motion.position(1.5)) > 10.0 * position_error


@pytest.mark.parametrize(("turn", "accepted"), [(0.98 * np.pi, True), (1.02 * np.pi, False)])
def test_more_than_half_a_turn_from_a_node_is_refused(turn: float, accepted: bool) -> None:
    times = np.linspace(0.0, 1.0, 401)
    imu = ImuSamples(times, np.tile([0.0, 0.0, turn], (401, 1)), np.zeros((401, 3)))
    if accepted:
        theta = preintegrate_frames(imu, 0.0, [1.0]).preintegrated[0, :3]
        np.testing.assert_allclose(theta, [0.0, 0.0, turn], atol=1e-12)
    else:
        with pytest.raises(FactorError, match=r"frame_times: the body turns by more than half"):
            preintegrate_frames(imu, 0.0, [1.0])


def test_cost_does_not_grow_with_the_recording() -> None:
    """Only the samples around the interval are looked at: the result is that of a short cut-out."""
    imu = simulate_imu(shaken_motion(0), 200.0, None, np.random.default_rng(0)).samples
    cut = slice(98, 143)
    part = ImuSamples(imu.times[cut], imu.gyroscope[cut], imu.accelerometer[cut])
    frames = 0.5 + np.arange(1, 9) * 0.025
    whole = preintegrate_frames(imu, 0.5, frames, BIAS)
    np.testing.assert_array_equal(
        preintegrate_frames(part, 0.5, frames, BIAS).preintegrated, whole.preintegrated
    )


def test_bias_dependence_of_the_segments_is_negligible() -> None:
    """H holds the segments fixed, though their half-step turn knows the bias: 0.1 s, 200 Hz."""
    imu = simulate_imu(shaken_motion(1), 200.0, None, np.random.default_rng(0)).samples
    frames = [0.5 + 0.1]
    motion = preintegrate_frames(imu, 0.5, frames, BIAS)
    step = np.array([0.0, 0.0, 0.0, 0.01, -0.01, 0.01])
    moved = gtsam.imuBias.ConstantBias(*np.split(BIAS.vector() + step, 2))
    anew = preintegrate_frames(imu, 0.5, frames, moved).preintegrated[0]
    difference = np.abs(motion.corrected(BIAS.vector() + step)[0] - anew)
    assert difference[:3].max() < 1e-6  # rad
    assert difference[3:6].max() < 1e-5  # m


def test_segments_cover_the_interval_and_break_where_told() -> None:
    imu = ImuSamples([0.0, 0.1, 0.2, 0.35], np.zeros((4, 3)), np.arange(12.0).reshape(4, 3))
    segments = list(imu.segments(0.05, 0.3, at=[0.15, 0.9]))
    np.testing.assert_allclose([s.dt for s in segments], [0.05, 0.05, 0.05, 0.1])
    # The mean of a linear signal over [0.05, 0.1] is its value at 0.075.
    np.testing.assert_allclose(
        segments[0].accelerometer, 0.75 * np.array([3.0, 3.0, 3.0]) + [0, 1, 2]
    )
    assert list(imu.segments(0.2, 0.2)) == []


def test_select_keeps_the_frames_asked_for() -> None:
    imu = simulate_imu(shaken_motion(0), 200.0, None, np.random.default_rng(0)).samples
    motion = preintegrate_frames(imu, 0.5, 0.5 + np.arange(5) * 0.02)
    some = motion.select([1, 4])
    assert len(some) == 2
    np.testing.assert_array_equal(some.preintegrated, motion.preintegrated[[1, 4]])
    with pytest.raises(FactorError, match="frames: index 7 is out of bounds"):
        motion.select([7])
