# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""The native edge search against numpy, its reference: the same points, found in the same lines."""

from typing import Any

import cv2
import numpy as np
import pytest

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.config import EdgesConfig
from ruledgraph.frontend import kernel
from ruledgraph.frontend.edge_batch import SEARCH_SETTINGS, Edges, Rulings, search_all
from ruledgraph.frontend.gradient import Gradient, gradient_by_opencv

needs_native = pytest.mark.skipif(
    kernel.native is None, reason="the native kernel was not built (no C++ compiler)"
)
CAMERAS = [
    CameraModel(320, 240, 300.0, 310.0, 160.0, 120.0),
    CameraModel(320, 240, 195.0, 194.0, 156.0, 124.0, "radtan", (-0.283, 0.074, 0.0002, 1.8e-5)),
    CameraModel(320, 240, 195.0, 194.0, 156.0, 124.0, "radtan", (-0.2, 0.05, 1e-3, -1e-3, 0.01)),
    CameraModel(320, 240, 150.0, 149.0, 160.0, 120.0, "equidistant", (0.01, 0.02, -0.01, 0.003)),
    CameraModel(320, 240, 300.0, 298.0, 160.0, 120.0, "omni", (0.9, -0.1, 0.02, 1e-3, -5e-4)),
    CameraModel(320, 240, 300.0, 298.0, 160.0, 120.0, "omni", (1.2,)),
    CameraModel(320, 240, 150.0, 149.0, 160.0, 120.0, "eucm", (0.6, 1.1)),
    CameraModel(320, 240, 110.0, 109.0, 160.0, 120.0, "ds", (-0.25, 0.56)),
]
POINTS = 1e-9


def clutter(rng: np.random.Generator, camera: CameraModel) -> np.ndarray:
    """Blurred strokes at random, and noise."""
    image = np.full((camera.height, camera.width), 120, np.uint8)
    for _ in range(12):
        a, b = rng.integers([-20, -20], [camera.width + 20, camera.height + 20], size=(2, 2))
        grey, width = int(rng.integers(40, 220)), int(rng.integers(1, 30))
        cv2.line(image, a.tolist(), b.tolist(), grey, width, cv2.LINE_AA)
    noisy = cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(scale=1.5, size=image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def random_rulings(rng: np.random.Generator, camera: CameraModel, image: np.ndarray) -> Rulings:
    """Near detected segments and anywhere, some across the border, in bands of any width."""
    found = cv2.createLineSegmentDetector().detect(image)[0].reshape(-1, 2, 2)
    long = found[np.linalg.norm(found[:, 1] - found[:, 0], axis=1) > 30.0]
    size = np.array([camera.width, camera.height])
    anywhere = rng.uniform(-0.2 * size, 1.2 * size, size=(10, 2, 2))
    pixels = np.concatenate([long + rng.normal(scale=1.5, size=long.shape), anywhere])
    rows = []
    for ends in pixels:
        normalised = camera.undistort(ends)
        if np.all(np.isfinite(normalised)):
            sigmas = rng.uniform(0.3, 7.0, size=2)
            slope = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.0, 30.0))
            rows.append((normalised, sigmas, slope))
    return Rulings(*map(np.array, zip(*rows, strict=True)))


def rulings_of(*each: tuple[Any, float, float]) -> Rulings:
    """Of ends, sigma and slope."""
    ends, sigmas, slopes = zip(*each, strict=True)
    return Rulings(np.array(ends), np.repeat(sigmas, 2).reshape(-1, 2), np.array(slopes))


@needs_native
@pytest.mark.parametrize("shape", [(480, 752), (240, 320), (7, 5), (3, 12), (2, 2), (1, 9), (1, 1)])
def test_the_gradient_is_that_of_opencv(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(3).integers(0, 256, shape, dtype=np.uint8)
    # Sums of floats up to 255 in another order: 3e-5 found.
    np.testing.assert_allclose(Gradient(image).xy, gradient_by_opencv(image), rtol=0.0, atol=1e-4)


@needs_native
@pytest.mark.parametrize("shape", [(0, 0), (5, 0), (0, 5)])
def test_no_image_has_no_gradient(shape: tuple[int, int]) -> None:
    assert Gradient(np.zeros(shape, np.uint8)).xy.shape == (*shape, 2)


@needs_native
def test_the_gradient_of_a_part_of_an_image() -> None:
    image = np.random.default_rng(4).integers(0, 256, (60, 80), dtype=np.uint8)
    part = image[10:50, 20:70:2]
    np.testing.assert_array_equal(Gradient(part).xy, Gradient(part.copy()).xy)
    with pytest.raises(ValueError, match="differ in size"):
        kernel.native.gradient(image, np.empty((60, 81, 2), np.float32), 1.0)


def by_both(
    monkeypatch: pytest.MonkeyPatch, camera: CameraModel, image: np.ndarray, *args
) -> tuple[Edges, Edges]:
    gradient = Gradient(image)
    monkeypatch.setenv("RULEDGRAPH_KERNEL", "native")
    native = search_all(gradient, camera, *args)
    monkeypatch.setenv("RULEDGRAPH_KERNEL", "numpy")
    return native, search_all(gradient, camera, *args)


def assert_same(native: Edges, numpy: Edges) -> None:
    # The same number of points, each in the same place: these are the same inliers.
    np.testing.assert_array_equal(native.counts, numpy.counts)
    np.testing.assert_allclose(native.points, numpy.points, rtol=0.0, atol=POINTS)
    np.testing.assert_allclose(native.ends, numpy.ends, rtol=0.0, atol=POINTS)
    # Rows of C may differ in sign.
    squared = [np.einsum("nki,nkj->nij", C, C) for C in (native.statistics, numpy.statistics)]
    np.testing.assert_allclose(*squared, rtol=0.0, atol=100 * POINTS)
    np.testing.assert_array_equal(native.support, numpy.support)
    np.testing.assert_array_equal(native.ambiguous, numpy.ambiguous)
    for name in ("lines", "rms_px", "slopes"):
        mine, other = getattr(native, name), getattr(numpy, name)
        np.testing.assert_allclose(mine, other, rtol=0.0, atol=1e-6, err_msg=name)
    for mine, other in zip(native, numpy, strict=True):
        assert mine.dtype == other.dtype
        assert mine.shape == other.shape


@needs_native
@pytest.mark.parametrize("beyond", [0.0, 0.06, 10.0])
@pytest.mark.parametrize("camera", CAMERAS, ids=lambda c: f"{c.distortion}{len(c.coefficients)}")
def test_kernels_find_the_same_points(camera, beyond, monkeypatch):
    found = ambiguous = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        image = clutter(rng, camera)
        native, numpy = by_both(
            monkeypatch, camera, image, random_rulings(rng, camera, image), beyond
        )
        assert_same(native, numpy)
        found += np.count_nonzero(numpy.counts)
        ambiguous += np.count_nonzero(numpy.ambiguous)
    # Far beyond their ends few lines go on.
    assert found > (50 if beyond < 1.0 else 2)
    assert ambiguous > 0 or beyond > 1.0


@needs_native
@pytest.mark.parametrize("camera", CAMERAS[:2], ids=lambda c: c.distortion)
def test_kernels_bend_rulings_alike(camera, monkeypatch):
    found = changed = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        image = clutter(rng, camera)
        rulings = random_rulings(rng, camera, image)
        bows = rng.normal(scale=2.0 / camera.fx, size=(len(rulings.ends), 2))
        native, numpy = by_both(monkeypatch, camera, image, rulings._replace(bows=bows), 0.06)
        assert_same(native, numpy)
        found += np.count_nonzero(numpy.counts)
        changed += not np.array_equal(
            numpy.counts, search_all(Gradient(image), camera, rulings, 0.06).counts
        )
    assert found > 20
    assert changed > 3


def test_a_bent_edge_is_found_along_its_parabola() -> None:
    """Bowed by 3 px over 160: straight on too few of its points are within 0.7 px of a line."""
    camera, rows = CAMERAS[0], np.arange(240)
    s = (rows - 40) / 160.0
    edge = 150.0 + 12.0 * s * (1.0 - s)
    columns = np.arange(320)
    image = np.clip(120.0 + 60.0 * (columns[None] - edge[:, None]), 60, 180).astype(np.uint8)
    ends = camera.undistort([[150.0, 40.0], [150.0, 200.0]])
    straight = rulings_of((ends, 2.0, -60.0))
    bent = straight._replace(bows=np.array([[3.0 / camera.fx, 0.0]]))
    edges = search_all(Gradient(image), camera, bent)
    assert edges.support[0] > 0.95
    assert edges.rms_px[0] < 0.05
    np.testing.assert_allclose(edges.lines[0], 0.0, atol=0.1)
    pixels = camera.distort(edges.points).pixels
    np.testing.assert_allclose(
        pixels[:, 0], np.interp(pixels[:, 1], rows, edge), rtol=0.0, atol=0.05
    )
    found = search_all(Gradient(image), camera, straight)
    assert found.counts[0] < 0.7 * edges.counts[0]


@needs_native
@pytest.mark.parametrize("name", SEARCH_SETTINGS)
def test_kernels_take_the_same_settings(name, monkeypatch):
    """Each changes what is found, and for both alike."""
    others = {"min_points": 30, "sigma_penalty": 1.0, "rival_share": 0.4}
    other = others.get(name, 2 * getattr(EdgesConfig(), name))
    camera, changed = CAMERAS[0], False
    for seed in range(4):
        rng = np.random.default_rng(seed)
        image = clutter(rng, camera)
        rulings = random_rulings(rng, camera, image)
        usual = search_all(Gradient(image), camera, rulings)
        native, numpy = by_both(
            monkeypatch, camera, image, rulings, 0.0, EdgesConfig(**{name: other})
        )
        assert_same(native, numpy)
        changed = changed or any(
            mine.shape != own.shape or not np.array_equal(mine, own)
            for mine, own in zip(native, usual, strict=True)
        )
    assert changed


@needs_native
def test_kernels_decide_ties_the_same_way(monkeypatch):
    # A picture without noise, symmetric about the ruling: two edges equally far, equal slopes.
    camera = CAMERAS[0]
    image = np.full((240, 320), 60, np.uint8)
    image[116:124] = 160
    image[130:140] = 160
    ends = np.array([[-0.4, 0.0], [0.4, 0.0]])
    for row in np.arange(100.0, 150.0, 0.5):
        own = ends + np.array([0.0, (row - camera.cy) / camera.fy])
        rulings = rulings_of(*((own, s, k) for s in (1.0, 2.5, 6.0) for k in (-20.0, 20.0)))
        native, numpy = by_both(monkeypatch, camera, image, rulings)
        assert_same(native, numpy)


@needs_native
def test_kernels_agree_on_what_cannot_be_searched(monkeypatch):
    camera = CAMERAS[1]
    rng = np.random.default_rng(0)
    image = clutter(rng, camera)
    ends = [
        [[0.1, 0.1], [0.1, 0.1]],
        [[np.nan, 0.1], [0.3, 0.1]],
        [[np.inf, 0.1], [0.3, 0.1]],
        [[5.0, 5.0], [6.0, 5.0]],
        [[-1e8, 0.0], [1e8, 0.0]],
    ]
    with np.errstate(invalid="ignore", over="ignore"):
        rulings = rulings_of(*((each, 2.0, 10.0) for each in ends))
        found = [by_both(monkeypatch, camera, image, rulings)]
    found.append(by_both(monkeypatch, camera, image, rulings.part([])))
    flat = rulings_of(([[-0.2, 0.0], [0.2, 0.0]], 2.0, 0.0))
    found.append(by_both(monkeypatch, camera, image, flat))
    for (native, numpy), count in zip(found, (len(ends), 0, 1), strict=True):
        assert_same(native, numpy)
        assert native.counts.tolist() == [0] * count


@needs_native
@pytest.mark.parametrize("sigma", [-1.0, 1e4, np.inf])
def test_a_band_that_cannot_be_searched_is_refused(sigma):
    rulings = rulings_of(([[-0.2, 0.0], [0.2, 0.0]], sigma, 10.0))
    with pytest.raises(ValueError, match="a sigma is not from 0 to 1000 px"):
        search_all(Gradient(np.zeros((240, 320), np.uint8)), CAMERAS[0], rulings)


@needs_native
def test_the_widest_band_is_searched():
    rulings = rulings_of(([[-0.2, 0.0], [0.2, 0.0]], 1000.0, 10.0))
    found = search_all(Gradient(np.zeros((240, 320), np.uint8)), CAMERAS[0], rulings)
    assert found.counts.tolist() == [0]


@needs_native
def test_a_sigma_that_is_not_finite_is_refused_by_both(monkeypatch):
    rulings = rulings_of(([[-0.2, 0.0], [0.2, 0.0]], np.nan, 10.0))
    for name in ("native", "numpy"):
        monkeypatch.setenv("RULEDGRAPH_KERNEL", name)
        with pytest.raises(ValueError, match=r"not from 0|NaN"):
            search_all(Gradient(np.zeros((240, 320), np.uint8)), CAMERAS[0], rulings)


def test_without_the_native_kernel_numpy_searches(monkeypatch):
    monkeypatch.setattr(kernel, "native", None)
    monkeypatch.delenv("RULEDGRAPH_KERNEL", raising=False)
    image = np.full((240, 320), 60, np.uint8)
    image[120:] = 160
    rulings = rulings_of(([[-0.4, 0.0], [0.4, 0.0]], 2.0, 20.0))
    found = search_all(Gradient(image), CAMERAS[0], rulings)
    assert found.counts[0] == len(found.points) > 8
    np.testing.assert_allclose(found.points[:, 1] * 310.0 + 120.0, 119.5, atol=1e-3)
