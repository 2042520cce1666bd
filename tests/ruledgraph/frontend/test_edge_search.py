# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from edge_images import CAMERA, edge_image, line_through
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.config import EdgesConfig
from ruledgraph.frontend.edge_search import Ruling, normal_of, scaled_to, search
from ruledgraph.frontend.gradient import Gradient

BARREL = CameraModel(
    320, 240, 195.0, 195.0, 156.0, 124.0, "radtan", (-0.283, 0.074, 0.0002, 1.8e-5)
)
ENDS = np.array([[-0.25, -0.1], [0.25, 0.15]])
FISHEYE = CameraModel(320, 240, 150.0, 150.0, 160.0, 120.0, "equidistant", (0.01, 0.0, 0.0, 0.0))


def random_ends(rng: np.random.Generator, camera: CameraModel, least: float = 80.0) -> np.ndarray:
    """Ends of a segment inside the image at least so many px long, normalised."""
    while True:
        pixels = rng.uniform([15, 15], [camera.width - 15, camera.height - 15], size=(2, 2))
        if np.linalg.norm(pixels[1] - pixels[0]) > least:
            return camera.undistort(pixels)


def shifted(ends: np.ndarray, offsets_px: tuple[float, float], camera: CameraModel) -> np.ndarray:
    offsets = np.array(offsets_px)[:, None] / camera.focal_length
    return ends + offsets * normal_of(ends)


@pytest.mark.parametrize("camera", [CAMERA, BARREL, FISHEYE], ids=lambda c: c.distortion)
def test_points_lie_on_the_edge_to_a_tenth_of_a_pixel(camera):
    # The prediction is up to 3 px off and turned; noise of 1.5 grey levels on a step of 60 leaves a
    # point about 0.05 px; the camera's scale differs from its focal length towards the rim.
    for seed in range(20):
        rng = np.random.default_rng(seed)
        ends = random_ends(rng, camera)
        line = line_through(*ends)
        gradient = Gradient(edge_image(camera, [(line, 60.0)], rng))
        predicted = shifted(ends, tuple(rng.uniform(-3, 3, 2)), camera)
        found = search(gradient, camera, Ruling(predicted, (2.0, 2.0), 20.0))
        assert found is not None
        assert not found.ambiguous
        assert found.support > 0.8
        homogeneous = np.column_stack([found.points, np.ones(len(found.points))])
        distance = homogeneous @ line * camera.focal_length
        assert np.sqrt(np.mean(distance**2)) < 0.15
        assert abs(distance.mean()) < 0.05
        assert np.all(np.diff(found.points @ (ends[1] - ends[0])) > 0.0)


def test_an_edge_of_the_other_polarity_is_another_edge():
    ends = np.array([[-0.2, -0.1], [0.25, 0.15]])
    gradient = Gradient(edge_image(CAMERA, [(line_through(*ends), 60.0)]))
    assert search(gradient, CAMERA, Ruling(ends, (2.0, 2.0), 20.0)) is not None
    assert search(gradient, CAMERA, Ruling(ends, (2.0, 2.0), -20.0)) is None
    # Read from its other end the same edge has the other sign.
    assert search(gradient, CAMERA, Ruling(ends[::-1], (2.0, 2.0), -20.0)) is not None


def test_an_edge_outside_the_band_is_not_found():
    ends = np.array([[-0.2, -0.1], [0.25, 0.15]])
    gradient = Gradient(edge_image(CAMERA, [(line_through(*ends), 60.0)]))
    predicted = shifted(ends, (12.0, 12.0), CAMERA)
    assert search(gradient, CAMERA, Ruling(predicted, (2.0, 2.0), 20.0)) is None
    assert search(gradient, CAMERA, Ruling(predicted, (5.0, 5.0), 20.0)) is not None


def test_two_like_edges_in_the_band_are_ambiguous():
    ends = np.array([[-0.3, -0.05], [0.3, 0.0]])
    other = shifted(ends, (8.0, 8.0), CAMERA)
    lines = [(line_through(*ends), 40.0), (line_through(*other), 40.0)]
    gradient = Gradient(edge_image(CAMERA, lines))
    between = shifted(ends, (4.0, 4.0), CAMERA)
    found = search(gradient, CAMERA, Ruling(between, (3.0, 3.0), 15.0))
    assert found is not None
    assert found.ambiguous
    near_one = search(gradient, CAMERA, Ruling(ends, (1.0, 1.0), 15.0))
    assert near_one is not None
    assert not near_one.ambiguous


def test_a_covered_stretch_gives_no_points():
    ends = np.array([[-0.4, 0.02], [0.4, -0.03]])
    image = edge_image(CAMERA, [(line_through(*ends), 60.0)])
    image[:, 120:180] = 90
    found = search(Gradient(image), CAMERA, Ruling(ends, (1.5, 1.5), 20.0))
    assert found is not None
    columns = CAMERA.distort(found.points).pixels[:, 0]
    assert not np.any((columns > 123) & (columns < 177))
    assert 0.5 < found.support < 0.85


@pytest.mark.parametrize(("seen", "is_line"), [(0.25, False), (0.45, True)])
def test_a_line_of_which_little_is_seen_is_not_found(seen, is_line):
    """There is an edge along this share of the ruling; a third is asked for."""
    ends = np.array([[-0.4, 0.02], [0.4, 0.02]])
    image = edge_image(CAMERA, [(line_through(*ends), 60.0)])
    image[:, : int(160 + 240 * (0.5 - seen))] = 90
    assert (search(Gradient(image), CAMERA, Ruling(ends, (1.5, 1.5), 20.0)) is not None) == is_line


def test_a_ruling_outside_the_image_or_too_short_finds_nothing():
    gradient = Gradient(edge_image(CAMERA, [(np.array([1.0, 0.0, 0.0]), 60.0)]))
    outside = np.array([[2.0, 0.0], [2.0, 0.3]])
    short = np.array([[0.0, 0.0], [0.0, 0.02]])
    assert search(gradient, CAMERA, Ruling(outside, (2.0, 2.0), -20.0)) is None
    assert search(gradient, CAMERA, Ruling(short, (2.0, 2.0), -20.0)) is None


def test_a_blank_image_gives_nothing():
    gradient = Gradient(np.full((240, 320), 90, np.uint8))
    ends = np.array([[-0.2, -0.1], [0.25, 0.15]])
    assert search(gradient, CAMERA, Ruling(ends, (4.0, 4.0), 20.0)) is None


def test_the_gradient_of_a_ramp():
    image = np.tile(np.arange(0, 240, 2, dtype=np.uint8), (60, 1))
    gradient = Gradient(image)
    pixels = np.array([[40.3, 30.7], [80.0, 20.0], [1.0, 30.0], [500.0, 30.0]])
    right = np.tile([1.0, 0.0], (4, 1))
    down = np.tile([0.0, 1.0], (4, 1))
    # float32 images
    np.testing.assert_allclose(gradient.along(pixels, right), [2.0, 2.0, 0.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(gradient.along(pixels, down), 0.0, atol=1e-4)


def stripe_image(width_px: float) -> np.ndarray:
    one, other = (line_through(*shifted(ENDS, (o, o), CAMERA)) for o in (0.0, -width_px))
    return edge_image(CAMERA, [(one, 60.0), (other, -60.0)], dark=120.0)


def test_edges_of_a_thin_stripe_are_left_out_for_blur_moves_them():
    # Its other edge lies outside the band.
    ruling = Ruling(ENDS, (0.4, 0.4), 20.0)
    thin, wide = Gradient(stripe_image(3.0)), Gradient(stripe_image(9.0))
    assert search(thin, CAMERA, ruling) is None
    found = search(wide, CAMERA, ruling)
    assert found is not None
    a, b = found.line
    assert abs(a + 0.5 * b) < 0.05


@pytest.mark.parametrize(
    ("focal", "stripe_px"), [(900.0, 5), (450.0, 5), (360.0, 4), (229.0, 3), (100.0, 3)]
)
def test_stripes_are_thinner_in_small_images_but_blur_is_not(focal, stripe_px):
    camera = replace(CAMERA, fx=focal, fy=focal)
    assert scaled_to(camera, EdgesConfig()).stripe_px == stripe_px
    assert scaled_to(camera, EdgesConfig(stripe_px=2)).stripe_px == 2
    assert scaled_to(camera, EdgesConfig(stripe_angle=0.0)).stripe_px == 3


def test_a_faint_neighbour_does_not_matter():
    line = line_through(*ENDS)
    beside = line_through(*shifted(ENDS, (-4.0, -4.0), CAMERA))
    image = edge_image(CAMERA, [(line, 60.0), (beside, -10.0)], dark=90.0)
    assert search(Gradient(image), CAMERA, Ruling(ENDS, (1.0, 1.0), 20.0)) is not None


def test_gradients_do_not_share_what_they_hold():
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 255, size, dtype=np.uint8) for size in ((40, 60), (30, 50), (40, 60))]
    alone = [Gradient(image).xy.copy() for image in images]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(Gradient, images * 20))
    for i, gradient in enumerate(together):
        np.testing.assert_array_equal(gradient.xy, alone[i % 3])
