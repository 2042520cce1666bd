# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Rendered edges against projected lines, occlusion, texture filtering."""

import cv2
import gtsam
import numpy as np
import pytest

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.errors import RuledgraphError
from ruledgraph.simulation.materials import plain
from ruledgraph.simulation.motions import WORLD_R_CAM
from ruledgraph.simulation.renderer import Renderer
from ruledgraph.simulation.scene import Scene, Surface, border_lines, box, panel, shell

PINHOLE = CameraModel(640, 480, 385.2, 384.9, 320.3, 238.6)
RADTAN = CameraModel(
    752, 480, 458.654, 457.296, 367.215, 248.375,
    "radtan", (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05),
)  # fmt: skip
FISHEYE = CameraModel(
    512, 512, 290.9, 290.9, 254.9, 256.9,
    "equidistant", (0.0034, 0.0007, -0.0020, 0.0002),
)  # fmt: skip
CAMERAS = {"pinhole": PINHOLE, "radtan": RADTAN, "equidistant": FISHEYE}


def camera_pose(position=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)) -> gtsam.Pose3:
    """At a position, turned from looking along +x by a rotation vector of camera axes."""
    rotation = gtsam.Rot3(WORLD_R_CAM) * gtsam.Rot3.Expmap(np.array(turn))
    return gtsam.Pose3(rotation, np.array(position))


def evenly_lit(surfaces: list[Surface], brightness: dict[str, int]) -> Scene:
    """A scene of constant brightness for each object, named by the first part of the name."""
    textures = [
        np.full((64, 64), brightness[surface.name.split(".")[0]], np.uint8) for surface in surfaces
    ]
    return Scene(surfaces, textures, *border_lines(surfaces))


WALL = shell((-2.0, -3.0, -2.0), (2.0, 3.0, 2.0), plain(0.5), plain(0.5), plain(0.5))


def card_scene() -> Scene:
    """A dark card that floats aslant before a bright wall."""
    turn = gtsam.Rot3.Ypr(0.3, 0.4, 0.15).matrix()
    right, down = turn @ [0.0, -0.9, 0.0], turn @ [0.0, 0.0, -0.7]
    card = panel("card", (1.5, 0.05, -0.03), right, down, plain(0.1))
    return evenly_lit([card, *WALL], {"card": 40, "room": 180})


def edge_errors(
    image: np.ndarray, camera: CameraModel, pose: gtsam.Pose3, ends: np.ndarray
) -> np.ndarray:
    """Distance of the visible edge from the projected line, px, in every row that it crosses.

    In columns when it is rather level. The edge is where the grey levels of the row say that one
    side ends and the other begins: the centroid of their differences. Nothing is shared with the
    renderer but the projection under test.
    """
    share = np.linspace(0.0, 1.0, 4000)[:, None]
    in_cam = np.array([pose.transformTo(p) for p in ends[0] + share * (ends[1] - ends[0])])
    pixels = camera.project(in_cam[in_cam[:, 2] > 0.1])
    extent = np.ptp(pixels, axis=0)
    if extent[0] > extent[1]:
        image, pixels = image.T, pixels[:, ::-1]
    if pixels[0, 1] > pixels[-1, 1]:
        pixels = pixels[::-1]
    height, width = image.shape
    rows = np.arange(max(np.ceil(pixels[0, 1]) + 8, 0), min(pixels[-1, 1] - 8, height - 1))
    columns = np.interp(rows, pixels[:, 1], pixels[:, 0])
    slant = np.abs(np.gradient(columns)) if len(rows) > 1 else np.zeros(len(rows))
    errors = []
    for row, column, slope in zip(rows.astype(int), columns, slant, strict=True):
        first, last = int(column) - 5, int(column) + 7
        if first >= 0 and last < width:
            difference = np.diff(image[row, first : last + 1].astype(float))
            found = difference @ (np.arange(first, last) + 0.5) / difference.sum()
            errors.append((found - column) / np.hypot(1.0, slope))
    return np.array(errors)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("seed", range(4))
def test_edges_lie_on_projected_lines(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera, scene = CAMERAS[name], card_scene()
    pose = camera_pose(rng.uniform(-0.15, 0.15, 3), rng.uniform(-0.12, 0.12, 3))
    image = Renderer(scene, camera).render(pose)
    errors = np.concatenate([edge_errors(image, camera, pose, ends) for ends in scene.lines[:4]])
    assert len(errors) > 300
    assert abs(errors.mean()) < 0.005
    assert np.quantile(np.abs(errors), 0.95) < 0.05


def test_edges_of_a_box_hide_what_is_behind() -> None:
    """A grey box before a dark card: inside the box's outline nothing of the card shows."""
    card = panel("card", (1.8, 0.0, 0.0), (0, -1.2, 0), (0, 0, -1.2), plain(0.1))
    grey = box("box", (1.0, 0.1, 0.0), (0.3, 0.4, 0.5), plain(0.5))
    scene = evenly_lit([card, *grey, *WALL], {"card": 40, "box": 120, "room": 180})
    for position in ((0.0, 0.0, 0.0), (0.2, 0.6, 0.5), (-0.3, -0.7, -0.4)):
        pose = camera_pose(position)
        image = Renderer(scene, PINHOLE).render(pose)
        corners = np.array([s.vertices for s in grey]).reshape(-1, 3)
        outline = PINHOLE.project(np.array([pose.transformTo(corner) for corner in corners]))
        hull = cv2.convexHull(outline.astype(np.float32))
        distance = np.array(
            [
                [cv2.pointPolygonTest(hull, (float(u), float(v)), True) for u in range(0, 640, 2)]
                for v in range(0, 480, 2)
            ]
        )
        seen = image[::2, ::2]
        # Where two of its faces meet, neither the card nor the wall shines through.
        np.testing.assert_allclose(seen[distance > 1.0], 120.0, atol=1e-3)
        # Outside of it are the card, the wall and their border.
        outside = seen[distance < -1.0]
        assert np.count_nonzero(np.isclose(outside, 40.0)) > 1000
        assert np.count_nonzero(np.isclose(outside, 180.0)) > 1000


def test_what_is_nearer_hides_what_is_farther_from_every_side() -> None:
    """Three bars that overlap in a circle: no order of whole bars is right."""
    bars = [
        ("a", (1.0, 0.0, 0.2), (0.9, 0.08, 0.08), (0.0, 0.35)),
        ("b", (1.0, -0.2, -0.1), (0.9, 0.08, 0.08), (2.1, 0.35)),
        ("c", (1.0, 0.2, -0.1), (0.9, 0.08, 0.08), (4.2, 0.35)),
    ]
    surfaces: list[Surface] = []
    for name, centre, size, (roll, tilt) in bars:
        # In the image plane turned by roll, then tilted towards the camera at one end.
        axes = gtsam.Rot3.Rx(roll).matrix() @ gtsam.Rot3.Rz(np.pi / 2 - tilt).matrix()
        surfaces += box(name, centre, size, plain(0.5), axes)
    scene = evenly_lit([*surfaces, *WALL], {"a": 50, "b": 100, "c": 150, "room": 250})
    renderer = Renderer(scene, PINHOLE)
    rng = np.random.default_rng(0)
    for _ in range(6):
        pose = camera_pose(rng.uniform(-0.4, 0.4, 3), rng.uniform(-0.1, 0.1, 3))
        image = renderer.render(pose)
        pixels = rng.integers([0, 0], [640, 480], size=(400, 2))
        for u, v in pixels:
            patch = image[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
            if np.ptp(patch) < 1e-3:
                assert image[v, u] == pytest.approx(nearest(scene, PINHOLE, pose, (u, v)))


def nearest(scene: Scene, camera: CameraModel, pose: gtsam.Pose3, pixel) -> float:
    """Brightness of the nearest surface that the ray of a pixel meets, one by one."""
    x, y = camera.undistort([pixel])[0]
    ray = pose.rotation().matrix() @ [x, y, 1.0]
    eye = pose.translation()
    best, brightness = np.inf, 0.0
    for surface, texture in zip(scene.surfaces, scene.textures, strict=True):
        s, t, depth = np.linalg.solve(
            np.stack([surface.right, surface.down, -ray], axis=1), eye - surface.corner
        )
        if 0 <= s <= 1 and 0 <= t <= 1 and 0 < depth < best and ray @ surface.normal < 0:
            best, brightness = depth, float(texture[0, 0])
    return brightness


@pytest.mark.parametrize("name", CAMERAS)
def test_textures_lie_where_they_are_painted(name: str) -> None:
    """The centroid of a soft spot in a texture, at two distances, to 0.08 px."""
    size, spot = 400, np.array([130.0, 260.0])
    u, v = np.meshgrid(np.arange(size), np.arange(size))
    bump = np.exp(-((u - spot[0]) ** 2 + (v - spot[1]) ** 2) / (2 * 4.0**2))
    card = panel("card", (1.0, 0.0, 0.0), (0, -0.8, 0), (0, 0, -0.8), plain(0.5))
    scene = Scene([card], [(200 * bump).astype(np.uint8)], *border_lines([card]))
    share = (spot + 0.5) / size
    at = card.corner + share[0] * card.right + share[1] * card.down
    for x in (0.0, -1.5):
        pose = camera_pose((x, 0.0, 0.0), (0.02, 0.03, 0.2))
        image = Renderer(scene, CAMERAS[name]).render(pose)
        rows, columns = np.indices(image.shape)
        centroid = np.array([(columns * image).sum(), (rows * image).sum()]) / image.sum()
        expected = CAMERAS[name].project([pose.transformTo(at)])[0]
        np.testing.assert_allclose(centroid, expected, atol=0.08)


@pytest.mark.parametrize("camera", [PINHOLE, RADTAN])
def test_walls_close_wherever_the_camera_looks(camera: CameraModel) -> None:
    """Walls that reach behind the camera, too; a seam shows in one pixel of a million."""
    renderer = Renderer(evenly_lit(WALL, {"room": 180}), camera)
    rng = np.random.default_rng(0)
    bad = 0
    for _ in range(30):
        position = rng.uniform([-1.7, -2.7, -1.7], [1.7, 2.7, 1.7])
        image = renderer.render(camera_pose(position, rng.uniform(-2, 2, 3)))
        bad += np.count_nonzero(np.abs(image - 180.0) > 1e-3)
        assert image.min() > 150.0
    assert bad < 30


def test_a_camera_that_cannot_be_inverted_is_refused() -> None:
    wide = CameraModel(512, 512, 100.0, 100.0, 255.5, 255.5, "radtan", (-0.4, 0.0, 0.0, 0.0))
    with pytest.raises(RuledgraphError, match="distortion has no inverse in all of the image"):
        Renderer(evenly_lit(WALL, {"room": 180}), wide)


def test_outside_of_its_image_circle_a_fisheye_sees_nothing() -> None:
    """Of a lens that sees 190 degrees from side to side 80 to each side are drawn."""
    focal = 255.0 / np.radians(190.0)
    camera = CameraModel(256, 256, focal, focal, 127.5, 127.5, "equidistant", (0.0,) * 4)
    image = Renderer(evenly_lit(WALL, {"room": 180}), camera).render(camera_pose())
    rows, columns = np.indices(image.shape) - 127.5
    angle = np.hypot(rows, columns) / focal
    assert np.all(image[angle > np.radians(80.1)] == 0.0)
    np.testing.assert_allclose(image[angle < np.radians(79.0)], 180.0, atol=1.0)
