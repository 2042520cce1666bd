# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The native kernel against numpy, its reference: to 1e-12, and the same at degenerate geometry."""

from collections.abc import Callable

import gtsam
import numpy as np
import pytest
from gtsam import noiseModel
from gtsam.symbol_shorthand import L, V, X

from numerics import factor_jacobians, relative_error
from random_factors import FORMS, POINTS, random_case
from ruledgraph_factors import (
    FactorError,
    FrameMotion,
    GeometricPoints,
    ImuSamples,
    LineChart,
    ReprojectionPoints,
    RuledSurfaceFactor,
    active_kernel,
    kernel,
    preintegrate_frames,
    ruled_surface_pose_factor,
)
from ruledgraph_factors.line_distance import line_angle
from ruledgraph_factors.line_fit import fit_line
from ruledgraph_factors.ruled_surface import State

needs_native = pytest.mark.skipif(
    kernel.native is None, reason="the native kernel was not built (no C++ compiler)"
)
BOUND = 1e-12


class ByBoth:
    """Calls the same function under both kernels."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._monkeypatch = monkeypatch

    def __call__(self, make: Callable[[], object]) -> tuple:
        results = []
        for name in ("native", "numpy"):
            self._monkeypatch.setenv("RULEDGRAPH_KERNEL", name)
            assert active_kernel() == name
            results.append(make())
        return tuple(results)


@pytest.fixture
def by_both(monkeypatch: pytest.MonkeyPatch) -> ByBoth:
    return ByBoth(monkeypatch)


def assert_same(
    factors: tuple[RuledSurfaceFactor, RuledSurfaceFactor],
    values: gtsam.Values,
    bound: float = BOUND,
) -> None:
    """The residual relative to a coordinate of 1, each Jacobian to its greatest entry."""
    native, numpy = (factor.unwhitenedError(values) for factor in factors)
    np.testing.assert_allclose(native, numpy, rtol=bound, atol=bound)
    native, numpy = (factor_jacobians(factor, values) for factor in factors)
    assert native.keys() == numpy.keys()
    for key, matrix in numpy.items():
        assert relative_error(native[key], matrix) < bound, gtsam.DefaultKeyFormatter(key)


@needs_native
@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("form", FORMS)
def test_residuals_and_jacobians_agree(form: str, kind, by_both: ByBoth) -> None:
    for seed in range(300):
        case = random_case(seed, frames=1 + seed % 9, points=1 + seed % 7)
        assert_same(by_both(lambda c=case: c.factor(form, kind)), case.values)


@needs_native
@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("angle", [0.29999, 0.30001, 1.0, 3.0])
def test_large_turns_agree(angle: float, kind, by_both: ByBoth) -> None:
    """On both sides of the limit between series and closed form, in the line and in the motion."""
    for seed in range(50):
        case = random_case(seed)
        axis = case.rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        turned = np.array(case.motion.preintegrated)
        turned[:, :3] = angle * axis
        case.motion = FrameMotion(
            case.motion.elapsed, turned, case.motion.bias_jacobian, case.motion.bias
        )
        case.values.update(L(0), np.append(0.1, angle * axis))
        assert_same(by_both(lambda c=case: c.factor("node", kind)), case.values)


@needs_native
def test_segments_agree(by_both: ByBoth) -> None:
    for seed in range(100):
        rng = np.random.default_rng(seed)
        times = np.cumsum(rng.uniform(0.002, 0.02, size=40))
        imu = ImuSamples(times, rng.normal(size=(40, 3)), rng.normal(size=(40, 3)))
        start, stop = np.sort(rng.uniform(times[0], times[-1], size=2))
        bias = gtsam.imuBias.ConstantBias(rng.normal(size=3), rng.normal(size=3))
        stop = start if seed == 0 else stop
        at = [start, stop, times[20], stop + 1.0, *rng.uniform(start, stop, size=seed % 5)]
        native, numpy = by_both(
            lambda imu=imu, a=start, b=stop, at=at, bias=bias: list(imu.segments(a, b, at, bias))
        )
        assert len(native) == len(numpy)
        for ours, reference in zip(native, numpy, strict=True):
            assert ours.dt == reference.dt
            np.testing.assert_allclose(
                ours.accelerometer, reference.accelerometer, rtol=0.0, atol=BOUND
            )
            np.testing.assert_allclose(ours.gyroscope, reference.gyroscope, rtol=0.0, atol=BOUND)


@needs_native
def test_plucker_coordinates_agree(by_both: ByBoth) -> None:
    for seed in range(100):
        case = random_case(seed)
        delta = case.rng.normal(size=4) * 10.0 ** case.rng.uniform(-6.0, 0.3)
        native, numpy = by_both(lambda c=case, d=delta: c.chart.plucker(d))
        for ours, reference in zip(native, numpy, strict=True):
            assert relative_error(ours, reference) < BOUND


@needs_native
def test_angles_of_lines_agree(by_both: ByBoth) -> None:
    for seed in range(100):
        case = random_case(seed)
        delta = case.rng.normal(size=4) * 10.0 ** case.rng.uniform(-6.0, 0.3)
        pose = case.values.atPose3(X(0))
        native, numpy = by_both(lambda c=case, d=delta, p=pose: line_angle(c.chart, d, p))
        for ours, reference in zip(native, numpy, strict=True):
            assert relative_error(np.asarray(ours), np.asarray(reference)) < BOUND


@needs_native
@pytest.mark.parametrize("kind", POINTS)
def test_fits_of_lines_agree(kind, by_both: ByBoth) -> None:
    prior = np.array([1.0, 1.0, 1e-4, 1e-4])
    for seed in range(50):
        case = random_case(seed, frames=2 + seed % 5, points=2 + seed % 7)
        spec = case.factor("node", kind).spec
        pose, velocity = case.values.atPose3(X(0)).matrix(), case.values.atVector(V(0))
        state = State(pose, velocity, np.zeros(6), spec.gravity, np.zeros(4))
        starts = list(case.rng.normal(size=(5, 4)) * 0.2)
        native, numpy = by_both(
            lambda spec=spec, at=state, starts=starts: fit_line(spec, at, starts, 1e4, prior, 2)
        )
        # Steps that are solved for make rounding larger.
        for ours, reference in zip(native, numpy, strict=True):
            assert relative_error(np.asarray(ours), np.asarray(reference)) < 1e-7, seed


def pose_factor(kind, chart: LineChart, points: np.ndarray) -> RuledSurfaceFactor:
    observed = kind.from_frames([points])
    return ruled_surface_pose_factor(
        noiseModel.Unit.Create(observed.rows), X(0), L(0), chart, observed
    )


def line(first, second) -> LineChart:
    anchor = gtsam.Pose3(gtsam.Rot3.Ypr(0.1, -0.2, 0.3), np.array([0.3, 0.2, -1.0]))
    return LineChart.from_points(anchor, first, second)


END_ON = np.array([0.25, -0.5])
DEGENERATE = {
    "through the camera": line([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
    "in the focal plane": line([0.0, 1.0, 0.0], [1.0, 1.0, 0.0]),
    "behind the camera": line([-1.0, 0.4, -2.0], [1.0, 0.4, -2.0]),
    "partly behind": line([-0.2, 0.1, -1.0], [0.3, 0.1, 2.0]),
    "end-on in a point": line([0.5, -1.0, 2.0], [1.0, -2.0, 4.0]),
    "parallel to a ray": line([1.0, 0.0, 2.0], [1.25, -0.5, 3.0]),
    "at infinity": LineChart.from_ruling(gtsam.Pose3(), [0.3, 1.0, -0.2], 0.0),
    "almost at infinity": LineChart.from_ruling(gtsam.Pose3(), [0.3, 1.0, -0.2], 1e-8),
    "beyond infinity": LineChart(
        gtsam.Pose3(), LineChart.from_ruling(gtsam.Pose3(), [0.3, 1.0, -0.2], 0.0).basis, -1e-3
    ),
    "through the anchor": line([0.3, 0.2, -1.0], [0.5, 0.1, 2.0]),
}


@needs_native
@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_geometry_agrees(name: str, kind, by_both: ByBoth) -> None:
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3())
    values.insert(L(0), np.zeros(4))
    points = np.array([[0.1, -0.2], [-0.4, 0.05], END_ON, [1.5, 0.3]])
    assert_same(by_both(lambda: pose_factor(kind, DEGENERATE[name], points)), values)


@needs_native
@pytest.mark.parametrize("slope", [1e-2, 1e-4, 1e-6])
def test_rulings_almost_through_the_camera_agree_to_their_conditioning(
    slope: float, by_both: ByBoth
) -> None:
    """|m_xy| = slope is a difference of numbers of the size of 1: so many digits are lost."""
    points = np.array([[0.1, -0.2], [-0.4, 0.05]])
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3())
    values.insert(L(0), np.zeros(4))
    for seed in range(50):
        rng = np.random.default_rng(seed)
        beside = slope * rng.normal(size=3)
        chart = line(beside, beside + rng.normal(size=3))
        factors = by_both(lambda c=chart: pose_factor(GeometricPoints, c, points))
        assert_same(factors, values, 1e-13 / slope)


@needs_native
@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("key", [X(0), V(0), L(0)])
def test_nan_agrees(key: int, kind, by_both: ByBoth) -> None:
    case = random_case(0)
    bad = gtsam.Pose3(gtsam.Rot3(), np.full(3, np.nan))
    sizes = {V(0): 3, L(0): 4}
    case.values.update(key, bad if key == X(0) else np.full(sizes[key], np.nan))
    native, numpy = by_both(lambda: case.factor("node", kind).unwhitenedError(case.values))
    np.testing.assert_array_equal(np.isnan(native), np.isnan(numpy))
    assert np.isnan(native).all()


def shaken_imu(seed: int, rate: float) -> ImuSamples:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.8, 1.2, size=int(rate)) / rate)
    return ImuSamples(times, rng.normal(size=(times.size, 3)), rng.normal(size=(times.size, 3)) * 9)


@needs_native
@pytest.mark.parametrize("rate", [30.0, 200.0, 1000.0])
def test_preintegration_agrees(rate: float, by_both: ByBoth) -> None:
    for seed in range(10):
        imu = shaken_imu(seed, rate)
        bias = gtsam.imuBias.ConstantBias(*np.random.default_rng(seed).normal(size=(2, 3)) * 0.1)
        frames = 0.2 + np.arange(9) * 0.033
        native, numpy = by_both(lambda i=imu, f=frames, b=bias: preintegrate_frames(i, 0.2, f, b))
        for name in ("preintegrated", "bias_jacobian"):
            assert relative_error(getattr(native, name), getattr(numpy, name)) < BOUND


@needs_native
def test_both_refuse_more_than_half_a_turn_at_the_same_time(by_both: ByBoth) -> None:
    times = np.linspace(0.0, 1.0, 101)
    imu = ImuSamples(times, np.tile([0.0, 4.0, 0.0], (101, 1)), np.zeros((101, 3)))

    def message() -> str:
        with pytest.raises(FactorError, match="more than half a turn") as caught:
            preintegrate_frames(imu, 0.0, [0.2, 0.5, 1.0])
        return str(caught.value)

    native, numpy = by_both(message)
    assert native == numpy
    assert "to 0.790 s" in native


def test_the_environment_chooses_the_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RULEDGRAPH_KERNEL", raising=False)
    assert active_kernel() == ("numpy" if kernel.native is None else "native")
    monkeypatch.setenv("RULEDGRAPH_KERNEL", "numpy")
    assert active_kernel() == "numpy"
    monkeypatch.setenv("RULEDGRAPH_KERNEL", "cuda")
    with pytest.raises(FactorError, match="RULEDGRAPH_KERNEL must be native or numpy, not 'cuda'"):
        active_kernel()


def test_without_the_native_kernel_numpy_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel, "native", None)
    monkeypatch.delenv("RULEDGRAPH_KERNEL", raising=False)
    assert active_kernel() == "numpy"
    case = random_case(0)
    assert np.isfinite(case.factor("node", ReprojectionPoints).error(case.values))
    monkeypatch.setenv("RULEDGRAPH_KERNEL", "native")
    with pytest.raises(FactorError, match="RULEDGRAPH_KERNEL is native, but that kernel was not"):
        active_kernel()


@needs_native
def test_compressed_points_agree(by_both: ByBoth) -> None:
    """Up to the sign of rows; points in number from one up, on a line as they are in practice."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        frames = [
            np.column_stack([x, 0.3 * x - 0.1 + rng.normal(scale=1e-3, size=x.size)])
            for x in (rng.uniform(-0.7, 0.7, size=rng.integers(1, 40)) for _ in range(6))
        ]
        weights = [rng.uniform(0.1, 2.0, size=len(points)) for points in frames]
        native, numpy = by_both(
            lambda f=frames, w=weights: GeometricPoints.from_frames(f, w, 15.0).statistics
        )
        signs = np.where(np.einsum("nii->ni", native * numpy) < 0.0, -1.0, 1.0)
        np.testing.assert_allclose(native, signs[..., None] * numpy, rtol=BOUND, atol=BOUND)
