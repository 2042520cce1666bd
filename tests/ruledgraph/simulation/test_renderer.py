# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Rendered edges against projected lines, occlusion, texture filtering."""

import cv2
import gtsam
import numpy as np
import pytest

from ruledgraph.errors import RuledgraphError
from ruledgraph.sensors import CameraModel
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
        if 0 <= first and last < width:
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
    errors = np.concatenate(
        [edge_errors(image, camera, pose, ends) for ends in scene.lines[:4]]
    )
    assert len(errors) > 300
    assert abs(errors.mean()) < 0.005
    assert np.quantile(np.abs(errors), 0.95) < 0.05
