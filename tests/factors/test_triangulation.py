# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Lines from several views."""

import gtsam
import numpy as np
import pytest

from ruledgraph_factors import (
    FactorError,
    GeometricPoints,
    LineTriangulation,
    kernel,
    triangulate_line,
)

SIGMA = 1e-3  # half a pixel at a focal length of 500 px


def random_pose(rng: np.random.Generator) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3.Expmap(rng.normal(size=3)), 3.0 * rng.normal(size=3))


def random_segment(
    rng: np.random.Generator, nearest: float = 0.8, farthest: float = 10.0
) -> np.ndarray:
    """Ends, (2, 3), in the first camera's frame, both in view, at any slant."""
    while True:
        ends = rng.uniform(-0.6, 0.6, size=(2, 2))
        if np.linalg.norm(ends[1] - ends[0]) > 0.3:
            break
    depths = np.exp(rng.uniform(np.log(nearest), np.log(farthest), size=(2, 1)))
    return depths * np.column_stack([ends, np.ones(2)])


def views(
    rng: np.random.Generator, centres: np.ndarray, ends: np.ndarray, sigma: float
) -> tuple[list[gtsam.Pose3], list[np.ndarray], np.ndarray]:
    """World poses of cameras at `centres`, their points, and the ends in the world."""
    world_T_first = random_pose(rng)
    cameras, points = [], []
    along = np.linspace(0.0, 1.0, 20)[:, None]
    for centre in centres:
        camera = gtsam.Pose3(gtsam.Rot3.Expmap(0.05 * rng.normal(size=3)), centre)
        inside = (ends[0] + along * (ends[1] - ends[0]) - centre) @ camera.rotation().matrix()
        seen = inside[:, :2] / inside[:, 2:]
        points.append(seen + rng.normal(scale=sigma, size=seen.shape))
        cameras.append(world_T_first * camera)
    return cameras, points, np.array([world_T_first.transformFrom(end) for end in ends])


def sideways(rng: np.random.Generator, count: int, reach: float) -> np.ndarray:
    """A path across the view."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.outer(np.linspace(0.0, reach, count), [np.cos(angle), np.sin(angle), 0.1])


def across(ends: np.ndarray) -> np.ndarray:
    """Normal of the plane through the first camera and the line."""
    normal = np.cross(*ends)
    return normal / np.linalg.norm(normal)


def error_of(found: LineTriangulation, ends: np.ndarray) -> np.ndarray:
    """delta of the true line in the chart of the one found."""
    return found.chart.local(np.cross(*ends), ends[1] - ends[0])


@pytest.mark.parametrize("count", [2, 3, 9])
def test_exact_points_give_the_line(count: int) -> None:
    for seed in range(100):
        rng = np.random.default_rng([seed, count])
        ends = random_segment(rng)
        centres = np.outer(np.linspace(0.0, 0.5, count), across(ends))
        cameras, points, truth = views(rng, centres, ends, 0.0)
        found = triangulate_line(cameras, points, 1e-6)
        assert found.determined, found.reason
        # The prior of sigma 1 and the descent's last steps: far below any noise of a camera's.
        np.testing.assert_allclose(error_of(found, truth), 0.0, atol=2e-3)
        assert found.rms < 1e-6


@pytest.mark.parametrize("sigma", [2e-3, 1e-3, 2e-4])
def test_the_error_is_as_the_covariance_says(sigma: float) -> None:
    nees = []
    for seed in range(300):
        rng = np.random.default_rng([seed, 1])
        ends = random_segment(rng)
        count = int(rng.integers(2, 10))
        cameras, points, truth = views(rng, sideways(rng, count, 0.6), ends, sigma)
        found = triangulate_line(cameras, points, sigma)
        if found.determined:
            error = error_of(found, truth)
            nees.append(error @ np.linalg.solve(found.covariance, error))
    assert len(nees) > 290  # the others moved in the plane of their line
    # 4 degrees of freedom each: three standard deviations of the mean. Of the wrong minima of a
    # line seen almost end-on, one of these sizes would show.
    assert abs(np.mean(nees) - 4.0) < 3.0 * np.sqrt(8.0 / len(nees))
    assert max(nees) < 40.0


def test_motion_within_the_plane_of_the_line_is_degenerate() -> None:
    for seed in range(50):
        rng = np.random.default_rng(seed)
        ends = random_segment(rng)
        direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        towards = ends.mean(axis=0) / np.linalg.norm(ends.mean(axis=0))
        motion = 0.1 * (rng.uniform(-1.0, 1.0) * direction + rng.uniform() * towards)
        centres = np.outer(np.linspace(0.0, 1.0, 6), motion)
        cameras, points, truth = views(rng, centres, ends, SIGMA)
        found = triangulate_line(cameras, points, SIGMA)
        assert (found.status, found.determined) == ("within_plane", False)
        assert "along the line, or straight towards it" in found.reason
        # Of distance and direction nothing is known but the prior; the plane is seen.
        sigmas = np.sqrt(np.diag(found.covariance))
        np.testing.assert_allclose(sigmas[:2], 1.0, rtol=1e-4)
        assert (sigmas[2:] < 0.05).all()
        np.testing.assert_allclose(error_of(found, truth)[2:], 0.0, atol=5 * sigmas[2:].max())


def test_other_degenerate_views_say_what_they_are() -> None:
    rng = np.random.default_rng(3)
    ends = np.array([[-0.5, -0.4, 2.0], [0.4, 0.5, 2.5]])
    cameras, points, _ = views(rng, np.zeros((3, 3)), ends, SIGMA)
    found = triangulate_line(cameras, points, SIGMA)
    assert (found.status, found.reason[:29]) == ("no_baseline", "all views are from one place:")
    assert triangulate_line(cameras[:1], points[:1], SIGMA).status == "no_baseline"

    path = np.outer(np.linspace(0.0, 0.5, 5), across(ends))
    cameras, points, _ = views(rng, path, 1000.0 * ends, SIGMA)
    found = triangulate_line(cameras, points, SIGMA)
    assert found.status == "no_parallax"
    assert "too little for a line so far away" in found.reason

    # As if the camera had moved the other way.
    cameras, points, _ = views(rng, path, ends, SIGMA)
    first = cameras[0]
    mirrored = [
        first * gtsam.Pose3(seen.rotation(), -seen.translation())
        for seen in (first.between(camera) for camera in cameras)
    ]
    assert triangulate_line(mirrored, points, SIGMA).status == "behind_camera"


def test_points_of_another_line_show_in_the_rms() -> None:
    rng = np.random.default_rng(0)
    ends = np.array([[-0.5, -0.4, 2.0], [0.4, 0.5, 2.5]])
    path = np.outer(np.linspace(0.0, 0.5, 8), across(ends))
    cameras, points, _ = views(rng, path, ends, SIGMA)
    assert triangulate_line(cameras, points, SIGMA).rms == pytest.approx(SIGMA, rel=0.2)
    points[4] = points[4] + [0.03, -0.03]
    assert triangulate_line(cameras, points, SIGMA).rms > 3.0 * SIGMA


def test_compressed_points_give_the_same() -> None:
    rng = np.random.default_rng(5)
    ends = random_segment(rng)
    cameras, points, _ = views(rng, sideways(rng, 4, 0.5), ends, SIGMA)
    by_points = triangulate_line(cameras, points, SIGMA)
    compressed = triangulate_line(cameras, GeometricPoints.from_frames(points), SIGMA)
    np.testing.assert_array_equal(by_points.covariance, compressed.covariance)


def test_wrong_arguments_are_named() -> None:
    rng = np.random.default_rng(6)
    cameras, points, _ = views(rng, sideways(rng, 2, 0.5), random_segment(rng), SIGMA)
    with pytest.raises(FactorError, match="points has 1 views, but world_T_cams has 2"):
        triangulate_line(cameras, points[:1], SIGMA)
    with pytest.raises(FactorError, match="points is empty"):
        triangulate_line([], [], SIGMA)
    with pytest.raises(FactorError, match="sigma must be positive"):
        triangulate_line(cameras, points, 0.0)
    with pytest.raises(FactorError, match=r"world_T_cams\[1\] must be a gtsam.Pose3"):
        triangulate_line([cameras[0], np.eye(4)], points, SIGMA)
    with pytest.raises(FactorError, match=r"points\[0\] all coincide"):
        triangulate_line(cameras, [np.full((5, 2), 0.1), points[1]], SIGMA)


@pytest.mark.skipif(kernel.native is None, reason="the native kernel was not built")
@pytest.mark.parametrize("reach", [0.0, 0.02, 0.5])
def test_the_kernels_agree(reach: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Far within the deviations: linear solutions and last steps are rounded differently."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        ends = random_segment(rng)
        cameras, points, _ = views(rng, sideways(rng, 2 + seed, reach), ends, SIGMA)
        monkeypatch.setenv("RULEDGRAPH_KERNEL", "native")
        native = triangulate_line(cameras, points, SIGMA)
        monkeypatch.setenv("RULEDGRAPH_KERNEL", "numpy")
        numpy = triangulate_line(cameras, points, SIGMA)
        assert (native.status, native.reason) == (numpy.status, numpy.reason)
        apart = numpy.chart.local(*np.split(native.chart.plucker(np.zeros(4))[0], 2))
        deviations = np.sqrt(np.diag(numpy.covariance))
        assert np.all(np.abs(apart) < 1e-4 * deviations), seed
        # The two may give the line opposite directions, and coordinates opposite signs.
        differs = np.abs(native.covariance) - np.abs(numpy.covariance)
        assert np.all(np.abs(differs) < 1e-4 * np.outer(deviations, deviations)), seed
        assert native.rms == pytest.approx(numpy.rms, rel=1e-6)
