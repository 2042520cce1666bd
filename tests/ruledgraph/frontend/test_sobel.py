# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause

import numpy as np

from edge_images import CAMERA, edge_image, line_through
from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.frontend.edge_search import Ruling
from ruledgraph.frontend.sobel import search_sobel, sobel_points

ENDS = np.array([[-0.2, -0.1], [0.25, 0.15]])
LINE = line_through(*ENDS)


def test_the_points_are_all_thresholded_pixels_within_the_gate():
    edges = sobel_points(edge_image(CAMERA, [(LINE, 60.0)]))
    found = search_sobel(edges, CAMERA, Ruling(ENDS, (2.0, 2.0), 20.0))
    assert found is not None
    v, u = np.nonzero(edges)
    normalised = CAMERA.undistort(np.stack([u, v], axis=1).astype(float))
    distance = (normalised @ LINE[:2] + LINE[2]) * CAMERA.focal_length
    along = ENDS[1] - ENDS[0]
    place = (normalised - ENDS[0]) @ along / (along @ along)
    # Pixels at the gate or the segment's ends are counted or not by rounding.
    least = np.sum((np.abs(distance) < 2.5) & (place > 0.02) & (place < 0.98))
    most = np.sum((np.abs(distance) < 3.5) & (place > -0.02) & (place < 1.02))
    assert least <= len(found.points) <= most
    assert len(np.unique(np.rint(CAMERA.distort(found.points).pixels), axis=0)) == len(found.points)
    homogeneous = np.column_stack([found.points, np.ones(len(found.points))])
    assert abs(np.mean(homogeneous @ LINE) * CAMERA.focal_length) < 0.2
    assert np.abs(homogeneous @ LINE * CAMERA.focal_length).max() <= 3.0 + 1e-6


def test_polarity_does_not_matter():
    edges = sobel_points(edge_image(CAMERA, [(LINE, -60.0)]))
    assert search_sobel(edges, CAMERA, Ruling(ENDS, (2.0, 2.0), 20.0)) is not None


def test_nothing_near_the_ruling():
    edges = sobel_points(edge_image(CAMERA, [(LINE, 60.0)]))
    beside = Ruling(ENDS + np.array([0.0, 0.1]), (2.0, 2.0), 20.0)
    assert search_sobel(edges, CAMERA, beside) is None
    outside = Ruling(ENDS + np.array([3.0, 0.0]), (2.0, 2.0), 20.0)
    assert search_sobel(edges, CAMERA, outside) is None


def test_points_beyond_where_the_camera_model_folds_over_are_no_edge():
    camera = CameraModel(320, 240, 160.0, 160.0, 160.0, 120.0, "radtan", (-0.33, 0.0, 0.0, 0.0))
    everywhere = np.ones((240, 320), dtype=bool)
    rng = np.random.default_rng(0)
    found = [
        search_sobel(everywhere, camera, Ruling(ends, (2.0, 2.0), 20.0))
        for ends in rng.uniform(-1.2, 1.2, size=(200, 2, 2))
    ]
    points = [edge.points for edge in found if edge is not None]
    assert len(points) > 20
    assert all(np.isfinite(own).all() for own in points)
