# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What the factors compute, against independent formulas; degenerate geometry."""

import copy
import gc

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import B, F, G, L, T, V, X
from scipy.optimize import minimize_scalar

from random_factors import FORMS, POINTS, random_case
from ruledgraph.calibration.imu_noise import D435I_LIKE
from ruledgraph.simulation import SplineMotion, simulate_imu
from ruledgraph_factors import (
    STANDARD_GRAVITY,
    FactorError,
    FrameMotion,
    GeometricPoints,
    LineChart,
    ReprojectionPoints,
    bin_points,
    preintegrate_frames,
    ruled_surface_factor,
    ruled_surface_factor_with_gravity_direction,
    ruled_surface_factor_with_gravity_vector,
    ruled_surface_pose_factor,
)


def pose_error(kind, chart: LineChart, points: np.ndarray, delta=(0, 0, 0, 0)) -> np.ndarray:
    """Unwhitened residual of one frame, camera at the origin of the world."""
    observed = kind.from_frames([points])
    noise = noiseModel.Unit.Create(observed.rows)
    factor = ruled_surface_pose_factor(noise, X(0), L(0), chart, observed)
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3())
    values.insert(L(0), np.asarray(delta, dtype=float))
    return factor.unwhitenedError(values)


def line_through(first, second, anchor: gtsam.Pose3 | None = None) -> LineChart:
    return LineChart.from_points(gtsam.Pose3() if anchor is None else anchor, first, second)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 50, 400, 2000])
@pytest.mark.parametrize("form", FORMS)
def test_compressed_error_equals_the_sum_over_points(form: str, count: int) -> None:
    """1e-9 relative, against the paper's distance from two projected points of the ruling."""
    for seed in range(5):
        case = random_case(seed, frames=3, points=count)
        factor = case.factor(form, GeometricPoints, sigma=0.01)
        gravity = {
            "node_gravity_direction": 9.81 * case.values.atUnit3(G(0)).unitVector(),
            "node_gravity_vector": case.values.atVector(G(1)),
        }.get(form, np.array(STANDARD_GRAVITY))
        motion = FrameMotion.at_rest() if form.startswith("pose") else case.motion
        pose = case.values.atPose3(X(0))
        poses = motion.predict(
            pose.rotation().matrix(),
            pose.translation(),
            case.values.atVector(V(0)),
            case.values.atConstantBias(B(0)).vector(),
            gravity,
            time_shift=case.values.atDouble(T(0)) if "time" in form else 0.0,
        )
        total = 0.0
        ends, _ = case.chart.end_points(case.values.atVector(L(0)), [-0.5, 0.5])
        for i in range(len(motion)):
            world_T_cam = (
                gtsam.Pose3(gtsam.Rot3(poses.rotation[i]), poses.position[i]) * case.body_T_cam
            )
            (x1, y1), (x2, y2) = (
                end[:2] / end[2] for end in (world_T_cam.transformTo(e) for e in ends)
            )
            if "focal" in form:
                x1, y1, x2, y2 = case.values.atDouble(F(0)) * np.array([x1, y1, x2, y2])
            x, y = case.frames[i].T
            distance = (y2 - y1) * x - (x2 - x1) * y + x2 * y1 - y2 * x1
            total += np.sum(distance**2) / ((x2 - x1) ** 2 + (y2 - y1) ** 2)
        assert factor.error(case.values) == pytest.approx(0.5 * total / 0.01**2, rel=1e-9)


def test_reprojection_residual_is_the_papers_with_the_alpha_that_minimises_its_objective() -> None:
    """alpha of Eq. 13 found numerically, then the residual of Eq. 12 with it."""
    for seed in range(100):
        rng = np.random.default_rng(seed)
        start = np.array([0.1, -0.2, 3.0]) + rng.normal(size=3) * 0.3
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        point = start[:2] / start[2] + rng.normal(size=2) * 0.05

        def depth_scaled(alpha: float, s=start, d=direction, p=point) -> float:
            on_line = s + alpha * d
            return float(np.sum((p * on_line[2] - on_line[:2]) ** 2))

        alpha = minimize_scalar(depth_scaled, options={"xtol": 1e-14}).x
        foot = start + alpha * direction
        if foot[2] < 0.1:
            continue
        residual = pose_error(
            ReprojectionPoints, line_through(start, start + direction), point[None]
        )
        # Brent's minimiser finds alpha to the square root of the precision.
        np.testing.assert_allclose(residual, point - foot[:2] / foot[2], atol=1e-6)


def test_both_residuals_vanish_on_the_ruling_and_measure_the_distance_beside_it() -> None:
    """For a ruling parallel to the image plane both are the plain distance."""
    chart = line_through([-1.0, 0.4, 2.0], [1.0, 0.4, 2.0])
    on_line = np.array([[-0.3, 0.2], [0.0, 0.2], [0.45, 0.2]])
    for kind in POINTS:
        assert np.linalg.norm(pose_error(kind, chart, on_line)) < 1e-15
        beside = pose_error(kind, chart, on_line + np.array([0.0, 0.01]))
        assert np.linalg.norm(beside) == pytest.approx(0.01 * np.sqrt(3.0))


def test_points_behind_the_camera_have_a_constant_reprojection_error() -> None:
    behind = line_through([-1.0, 0.4, -2.0], [1.0, 0.4, -2.0])
    points = np.array([[0.1, -0.2], [0.2, -0.2]])
    np.testing.assert_array_equal(pose_error(ReprojectionPoints, behind, points), 2.0)
    # The geometric residual is about the infinite line's image, wherever the line is.
    np.testing.assert_allclose(pose_error(GeometricPoints, behind, points), 0.0, atol=1e-15)

    factor = ruled_surface_pose_factor(
        noiseModel.Unit.Create(4), X(0), L(0), behind, ReprojectionPoints.from_frames([points])
    )
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3())
    values.insert(L(0), np.zeros(4))
    np.testing.assert_array_equal(factor.linearize(values).jacobian()[0], 0.0)


def test_a_line_carried_beyond_infinity_is_behind_for_the_reprojection_error() -> None:
    far = LineChart.from_ruling(gtsam.Pose3(), [0.0, 1.0, -0.2], 0.01)
    points = np.array([[0.1, 0.2]])
    np.testing.assert_allclose(pose_error(ReprojectionPoints, far, points), 0.0, atol=1e-15)
    beyond = pose_error(ReprojectionPoints, far, points, [-0.02, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(beyond, 2.0)


def test_line_without_a_ruling_carries_no_information() -> None:
    """Through the camera's centre, or in its focal plane: zero rows, finite everywhere."""
    anchor = gtsam.Pose3(gtsam.Rot3(), np.array([0.3, 0.2, -1.0]))
    through_centre = line_through([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], anchor)
    focal_plane = line_through([0.0, 1.0, 0.0], [1.0, 1.0, 0.0], anchor)
    for chart in (through_centre, focal_plane):
        points = GeometricPoints.from_frames([np.array([[0.1, 0.2], [0.3, -0.2]])])
        factor = ruled_surface_pose_factor(noiseModel.Unit.Create(3), X(0), L(0), chart, points)
        values = gtsam.Values()
        values.insert(X(0), gtsam.Pose3())
        values.insert(L(0), np.zeros(4))
        assert factor.error(values) == 0.0
        assert np.all(factor.linearize(values).jacobian()[0] == 0.0)


def test_ruling_seen_end_on_in_the_point_has_zero_reprojection_error() -> None:
    point = np.array([0.25, -0.5])
    ray = np.append(point, 1.0)
    chart = line_through([1.0, 0.0, 2.0], np.array([1.0, 0.0, 2.0]) + ray)
    residual = pose_error(ReprojectionPoints, chart, point[None])
    np.testing.assert_allclose(residual, 0.0, atol=1e-12)


def test_gravity_variables_mean_what_gtsams_imu_factors_mean() -> None:
    """One Unit3 for both: with GTSAM's own factor at zero error, our prediction is right, too."""
    if not hasattr(gtsam, "CombinedImuFactorWithGravityDirection"):
        pytest.skip("this GTSAM has no CombinedImuFactorWithGravityDirection")
    rng = np.random.default_rng(0)
    times = np.linspace(0.0, 1.0, 8)
    truth = SplineMotion(times, rng.normal(size=(8, 3)) * 0.1, rng.normal(size=(8, 3)) * 0.1)
    imu = simulate_imu(truth, 1000.0, None, rng).samples
    frame_motion = preintegrate_frames(imu, 0.2, [0.3, 0.4])
    params = D435I_LIKE.preintegration_params()
    bias = gtsam.imuBias.ConstantBias()
    preintegrated = gtsam.PreintegratedCombinedMeasurements(params, bias)
    for segment in imu.segments(0.2, 0.4, at=[0.3]):
        preintegrated.integrateMeasurement(*segment)
    # A world turned so that gravity is not along an axis: the sign and frame of G matter.
    turn = gtsam.Pose3(gtsam.Rot3.Ypr(0.4, 0.9, -0.5), np.zeros(3))
    down = turn.rotation().rotate(np.array([0.0, 0.0, -1.0]))
    values = gtsam.Values()
    for i, time in enumerate((0.2, 0.4)):
        values.insert(X(i), turn * truth.pose(time))
        values.insert(V(i), turn.rotation().rotate(truth.velocity(time)))
        values.insert(B(i), bias)
    values.insert(G(0), gtsam.Unit3(down))
    values.insert(G(1), 9.81 * down)
    keys = (X(0), V(0), X(1), V(1), B(0), B(1))
    native = (
        gtsam.CombinedImuFactorWithGravityDirection(*keys, G(0), preintegrated, 9.81),
        gtsam.CombinedImuFactorWithGravityVector(*keys, G(1), preintegrated),
    )
    ends = turn.transformFrom(np.array([2.0, 0.1, 0.3])), turn.transformFrom(np.array([2, 0.6, 0]))
    chart = line_through(*ends, anchor=values.atPose3(X(0)))
    body_T_cam = gtsam.Pose3(gtsam.Rot3.Ypr(-np.pi / 2, 0.0, -np.pi / 2), np.array([0.02, 0, 0]))
    frames = []
    for time in (0.3, 0.4):
        world_T_cam = turn * truth.pose(time) * body_T_cam
        seen = np.array([world_T_cam.transformTo(e) for e in ends])
        frames.append(seen[:, :2] / seen[:, 2:])
    points = GeometricPoints.from_frames(frames)
    noise = noiseModel.Isotropic.Sigma(6, 1.0)
    rest = (frame_motion, chart, points, body_T_cam)
    values.insert(L(0), np.zeros(4))
    ours = (
        ruled_surface_factor_with_gravity_direction(noise, X(0), V(0), B(0), G(0), L(0), *rest),
        ruled_surface_factor_with_gravity_vector(noise, X(0), V(0), B(0), G(1), L(0), *rest),
        ruled_surface_factor(noise, X(0), V(0), B(0), L(0), *rest, gravity=9.81 * down),
    )
    for factor in native:
        # 1000 Hz samples of an exact motion: micrometres.
        assert np.abs(factor.unwhitenedError(values)).max() < 1e-4
    for factor in ours:
        assert np.abs(factor.unwhitenedError(values)).max() < 1e-5
    values.update(G(0), gtsam.Unit3(-down))
    assert np.abs(ours[0].unwhitenedError(values)).max() > 1e-2


@pytest.mark.parametrize("bin_width", [0.5e-3, 2e-3, 5e-3])
def test_binned_points_stay_within_the_bound_of_the_unbinned_factor(bin_width: float) -> None:
    """A rolling shutter's rows, each with its own time, of an edge without noise.

    Unbinned every residual is zero. Binned, a point is off by what the ruling moves in the time
    between the point's and its bin's: at most |t - t_bin| x its image speed. The residual has to
    keep that bound, and to be of its size: with the bins' times wrong by a bin it does not.
    """
    rng = np.random.default_rng(0)
    waypoints = np.linspace(0.0, 1.0, 8)
    truth = SplineMotion(waypoints, rng.normal(size=(8, 3)) * 0.1, rng.normal(size=(8, 3)) * 0.1)
    imu = simulate_imu(truth, 2000.0, None, rng).samples
    body_T_cam = gtsam.Pose3(gtsam.Rot3.Ypr(-np.pi / 2, 0.0, -np.pi / 2), np.zeros(3))
    ends = np.array([[2.0, 0.3, -0.6], [2.3, 0.1, 0.7]])
    times = np.sort(rng.uniform(0.4, 0.43, size=400))
    shares = rng.uniform(size=400)

    def image_of(time: float, share: float) -> np.ndarray:
        in_cam = (truth.pose(time) * body_T_cam).transformTo(ends[0] + share * (ends[1] - ends[0]))
        return in_cam[:2] / in_cam[2]

    points = np.array([image_of(t, s) for t, s in zip(times, shares, strict=True)])
    later = np.array([image_of(t + 1e-4, s) for t, s in zip(times, shares, strict=True)])
    speeds = np.linalg.norm(later - points, axis=1) / 1e-4
    values = gtsam.Values()
    values.insert(X(0), truth.pose(0.4))
    values.insert(V(0), truth.velocity(0.4))
    values.insert(B(0), gtsam.imuBias.ConstantBias())
    values.insert(L(0), np.zeros(4))
    chart = line_through(ends[0], ends[1], truth.pose(0.4) * body_T_cam)

    def residual_norm(width: float, late: float = 0.0) -> float:
        bin_times, binned = bin_points(times, points, width)
        observed = GeometricPoints.from_frames(binned)
        motion = preintegrate_frames(imu, 0.4, bin_times + late)
        noise = noiseModel.Unit.Create(observed.rows)
        factor = ruled_surface_factor(
            noise, X(0), V(0), B(0), L(0), motion, chart, observed, body_T_cam
        )
        return float(np.linalg.norm(factor.unwhitenedError(values)))

    bin_times, binned = bin_points(times, points, bin_width)
    assert len(bin_times) <= 0.03 / bin_width + 1
    own_bins = np.repeat(bin_times, [len(b) for b in binned])  # times are sorted, so are the bins
    bound = float(np.linalg.norm((times - own_bins) * speeds))
    assert residual_norm(0.0) < 0.01 * bound
    assert residual_norm(bin_width) < 1.01 * bound
    assert residual_norm(bin_width, late=bin_width) > 1.01 * bound


def test_nan_values_give_a_nan_error_never_a_small_one() -> None:
    for kind in POINTS:
        case = random_case(0)
        factor = case.factor("pose", kind)
        case.values.update(L(0), np.full(4, np.nan))
        assert np.isnan(factor.error(case.values))


def test_robust_noise_models_weigh_the_factor() -> None:
    case = random_case(0)
    points = GeometricPoints.from_frames(case.frames)
    gaussian = noiseModel.Isotropic.Sigma(points.rows, 1e-3)
    huber = noiseModel.Robust.Create(noiseModel.mEstimator.Huber.Create(1.345), gaussian)
    arguments = (X(0), V(0), B(0), L(0), case.motion, case.chart, points, case.body_T_cam)
    plain = ruled_surface_factor(gaussian, *arguments)
    robust = ruled_surface_factor(huber, *arguments)
    norm = np.sqrt(2.0 * plain.error(case.values))
    assert norm > 1.345
    assert plain.error(case.values) == pytest.approx(0.5 * norm**2)
    assert robust.error(case.values) == pytest.approx(1.345 * (norm - 0.5 * 1.345))


def test_factor_outlives_its_python_object_in_a_graph() -> None:
    case = random_case(0)
    graph = gtsam.NonlinearFactorGraph()
    graph.add(case.factor("node"))
    expected = case.factor("node").error(case.values)
    gc.collect()
    assert graph.error(case.values) == expected
    assert graph.linearize(case.values).size() == 1


def test_factor_can_be_cloned_and_copied_but_gtsam_cannot_rekey_it() -> None:
    case = random_case(0)
    factor = case.factor("node")
    for copied in (factor.clone(), copy.copy(factor), copy.deepcopy(factor)):
        assert copied is not factor
        assert copied.error(case.values) == factor.error(case.values)
    with pytest.raises(RuntimeError, match="no clone"):
        factor.rekey([X(5), V(5), B(5), L(5)])


@pytest.mark.parametrize("form", FORMS)
def test_a_weight_multiplies_the_squares_that_gtsam_sees(form: str) -> None:
    case = random_case(4)
    factor = case.factor(form, GeometricPoints)
    before = factor.error(case.values), factor.linearize(case.values).information()
    plain = factor.unwhitenedError(case.values)
    factor.weight = 0.3
    assert factor.weight == pytest.approx(0.3)
    assert factor.error(case.values) == pytest.approx(0.3 * before[0], rel=1e-12)
    information = factor.linearize(case.values).information()
    np.testing.assert_allclose(information, 0.3 * before[1], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        factor.unwhitenedError(case.values), np.sqrt(0.3) * plain, rtol=1e-12
    )
    assert factor.clone().weight == 1.0


@pytest.mark.parametrize("weight", [0.0, -1.0, np.nan, np.inf])
def test_a_weight_is_positive_and_finite(weight: float) -> None:
    factor = random_case(4).factor("node", GeometricPoints)
    with pytest.raises(FactorError, match="weight"):
        factor.weight = weight
    assert factor.weight == 1.0
