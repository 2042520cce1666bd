# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Images of a scene, faithful to a small fraction of a pixel.

Every pixel's own ray, distortion included, is intersected with the planes of the surfaces: nothing
is warped twice. Textures are averaged over the pixel, separately along their two axes, so that a
wall seen aslant stays sharp across. Where a surface ends, a pixel gets the share that its distance
from the projected border leaves to each side, exact for a straight border.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import gtsam
import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.simulation.camera_rays import BentRays, Image, PinholeRays
from ruledgraph.simulation.occlusion import CUT, FREE, Fragment, PaintersOrder
from ruledgraph.simulation.scene import Scene, Texture

# Nothing nearer than this is seen, m.
_NEAR = 0.02
# A border that the next surface will cover is moved out by this, px, so that nothing behind the two
# shows through between them.
_OVERLAP = 1.0
# The pieces of a cut surface overlap by this, px: in float32 the cut could stay open.
_SEAM = 0.02
# How far outside its outline a surface may touch a pixel, px; with room for the bulge that
# distortion gives an edge between two points of the rim below.
_MARGIN = 1.5
# Points around the border of the unit square.
_RIM = np.array(
    [[x, y] for x in np.linspace(0, 1, 7) for y in np.linspace(0, 1, 7) if {x, y} & {0, 1}]
)


class _Boxes(NamedTuple):
    """Bounding boxes of n fragments, clipped to the image."""

    low: FloatArray
    """Smallest and largest normalised coordinates, (n, 2) each."""
    high: FloatArray
    pixels: NDArray[np.int64]
    """First row, row behind the last, first column, column behind the last, (n, 4)."""


class _Surfaces(NamedTuple):
    """Where the parallelograms of a scene are, all (n, ...), m."""

    corners: FloatArray
    """(n, 3)."""
    sides: FloatArray
    """To the right and down, (n, 2, 3)."""
    normals: FloatArray
    """(n, 3)."""

    @classmethod
    def of(cls, scene: Scene) -> "_Surfaces":
        return cls(
            np.array([surface.corner for surface in scene.surfaces]),
            np.array([[s.right, s.down] for s in scene.surfaces]),
            np.array([surface.normal for surface in scene.surfaces]),
        )


class _Mesh:
    """The vertices of fragments, one after another."""

    def __init__(self, fragments: Sequence[Fragment]) -> None:
        self.surfaces = np.array([fragment.surface for fragment in fragments])
        """The number of each fragment's surface."""
        self.vertices = np.concatenate([fragment.vertices for fragment in fragments])
        """(m, 3), m."""
        stops = np.cumsum([len(fragment.vertices) for fragment in fragments])
        self.starts = np.concatenate([[0], stops[:-1]])
        """The first vertex of each fragment."""
        self.spans = [slice(*span) for span in zip(self.starts, stops, strict=True)]
        """The vertices of each fragment."""
        self.fragments = np.repeat(np.arange(len(fragments)), np.diff([0, *stops]))
        """The number of each vertex' fragment."""
        self.following = np.arange(1, len(self.vertices) + 1)
        """The vertex after each, around its fragment."""
        self.following[stops - 1] = self.starts


class Renderer:
    """Draws one scene for one camera.

    Raises:
        RuledgraphError: for a camera whose distortion has no inverse somewhere, but for a fisheye.
    """

    def __init__(self, scene: Scene, camera: CameraModel) -> None:
        self._camera = camera
        self._rays = PinholeRays(camera) if camera.distortion == "none" else BentRays(camera)
        self._textures = [_Pyramid(texture) for texture in scene.textures]
        self._surfaces = _Surfaces.of(scene)
        self._order = PaintersOrder(scene.surfaces)
        self._mesh = _Mesh(self._order.fragments)
        # Inward normals of the planes that bound the field of view, with a margin for surfaces
        # that cover part of a border pixel.
        margin = _MARGIN / self._rays.scale
        (left, top), (right, bottom) = self._rays.field + np.array([[-margin], [margin]])
        self._field_planes = np.array(
            [[0, 0, 1], [1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]], dtype=float
        )

    def render(self, world_T_cam: gtsam.Pose3, rows: slice | None = None) -> Image:
        """Brightness of every pixel, 0 to 255, (height, width); of some rows if these are given,
        the others being 0.
        """
        eye, world_R_cam = world_T_cam.translation(), world_T_cam.rotation().matrix()
        in_cam = (self._mesh.vertices - eye) @ world_R_cam
        inside = in_cam @ self._field_planes.T - [_NEAR, 0.0, 0.0, 0.0, 0.0]
        faces_eye = np.sum((eye - self._surfaces.corners) * self._surfaces.normals, axis=1) > 1e-6
        visible = np.all(np.maximum.reduceat(inside, self._mesh.starts) > 0.0, axis=1)
        visible &= faces_eye[self._mesh.surfaces]
        boxes = self._boxes(in_cam)
        if rows is not None:
            np.clip(boxes.pixels[:, :2], rows.start, rows.stop, out=boxes.pixels[:, :2])
        visible &= (boxes.pixels[:, 0] < boxes.pixels[:, 1]) & (
            boxes.pixels[:, 2] < boxes.pixels[:, 3]
        )

        # A point of a surface is corner + s right + t down = eye + depth * ray, so (s, t, 1) is
        # proportional to the inverse of [right, down, corner - eye] times the ray.
        columns = np.concatenate(
            [self._surfaces.sides, (self._surfaces.corners - eye)[:, None]], axis=1
        )
        columns[~faces_eye] = np.eye(3)
        maps = np.linalg.inv(columns.transpose(0, 2, 1)) @ world_R_cam
        # The plane through the eye and an edge tells the two sides of its image apart, even where
        # the edge reaches behind the camera. Vertices are clockwise, hence inside is positive.
        planes = np.cross(in_cam, in_cam[self._mesh.following])
        planes /= np.linalg.norm(planes[:, :2], axis=1, keepdims=True) + 1e-12
        partial = self._partial(planes, boxes)

        canvas = np.zeros((self._camera.height, self._camera.width), dtype=np.float32)
        painted = ~faces_eye
        for index in self._order.seen_from(eye):
            if not visible[index]:
                continue
            surface, span = int(self._mesh.surfaces[index]), self._mesh.spans[index]
            first_row, end_row, first_column, end_column = boxes.pixels[index].tolist()
            view = slice(first_row, end_row), slice(first_column, end_column)
            middle = 0.5 * (boxes.low[index] + boxes.high[index])
            texture, H = self._textures[surface].at(
                maps[surface], middle, self._rays.scale_at(*view)
            )
            pixels = self._rays.sample(texture, H, *view)
            edges = self._order.fragments[index].edges
            cover: Image | None = None
            for vertex, edge in zip(range(span.start, span.stop), edges, strict=True):
                if partial[vertex]:
                    distance = self._rays.distance(planes[vertex], *view)
                    inside = _inside(distance, edge, bool(painted[edge]))
                    cover = inside if cover is None else np.minimum(cover, inside, out=cover)
            part = canvas[view]
            if cover is None:
                part[...] = pixels
            else:
                part += cover * (pixels - part)
            painted[surface] = True
        if self._rays.seen is not None:
            canvas[~self._rays.seen] = 0.0
        return canvas

    def _boxes(self, in_cam: FloatArray) -> _Boxes:
        """Bounding boxes of all fragments, from their vertices in the camera frame."""
        camera = self._camera
        with np.errstate(divide="ignore", invalid="ignore"):
            normalised = in_cam[:, :2] / in_cam[:, 2:]
        low = np.minimum.reduceat(normalised, self._mesh.starts)
        high = np.maximum.reduceat(normalised, self._mesh.starts)
        behind = in_cam[:, 2] < _NEAR
        for index in np.flatnonzero(np.logical_or.reduceat(behind, self._mesh.starts)):
            in_front = _in_front(in_cam[self._mesh.spans[index]])
            rays = in_front[:, :2] / in_front[:, 2:] if len(in_front) else np.zeros((1, 2))
            low[index], high[index] = rays.min(axis=0), rays.max(axis=0)
        low, high = np.clip(low, *self._rays.field), np.clip(high, *self._rays.field)
        if camera.distortion == "none":
            focal, centre = (camera.fx, camera.fy), (camera.cx, camera.cy)
            first, last = low * focal + centre, high * focal + centre
        else:
            rim = low[:, None] + _RIM * (high - low)[:, None]
            pixels = camera.distort(rim.reshape(-1, 2)).pixels.reshape(rim.shape)
            first, last = pixels.min(axis=1), pixels.max(axis=1)
        size = (camera.width, camera.height)
        start = np.maximum(np.ceil(first - _MARGIN), 0.0).astype(int)
        stop = np.minimum(np.floor(last + _MARGIN) + 1.0, size).astype(int)
        edges = [start[:, 1], stop[:, 1], start[:, 0], stop[:, 0]]
        return _Boxes(low, high, np.stack(edges, axis=1))

    def _partial(self, planes: FloatArray, boxes: _Boxes) -> NDArray[np.bool_]:
        """For every edge: whether it leaves any pixel of its fragment's box less than full."""
        margin = (_MARGIN + 1.0) / self._rays.scale
        corner = np.where(
            planes[:, :2] > 0.0,
            (boxes.low - margin)[self._mesh.fragments],
            (boxes.high + margin)[self._mesh.fragments],
        )
        least = np.sum(planes[:, :2] * corner, axis=1) + planes[:, 2]
        return np.asarray(least * self._rays.scale < 0.5)


def _in_front(polygon: FloatArray) -> FloatArray:
    """The part of a polygon (k, 3) in front of the camera."""
    kept = []
    for start, stop in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if start[2] >= _NEAR:
            kept.append(start)
        if (start[2] >= _NEAR) != (stop[2] >= _NEAR):
            kept.append(start + (_NEAR - start[2]) / (stop[2] - start[2]) * (stop - start))
    return np.array(kept)


def _inside(distance: Image, edge: int, is_painted: bool) -> Image:
    """Share of each pixel on the inner side of an edge.

    Args:
        distance: of the pixels from the edge, px, positive inside; used up.
        edge: what is beyond, see `Fragment`.
        is_painted: the surface beyond is painted already, or faces away.
    """
    if edge == CUT:
        return np.asarray(distance >= -_SEAM, dtype=np.float32)
    if edge == FREE or is_painted:
        distance += np.float32(0.5)
        return np.clip(distance, 0.0, 1.0, out=distance)
    return np.asarray(distance >= -_OVERLAP, dtype=np.float32)


class _Pyramid:
    """A texture at lower resolutions, halved along each axis on its own; made when first needed."""

    def __init__(self, texture: Texture) -> None:
        self._levels = {(0, 0): texture}

    def at(
        self, to_surface: FloatArray, ray: FloatArray, scale: float
    ) -> tuple[Texture, FloatArray]:
        """The texture whose pixels are about as large as an image pixel, and the map to them.

        Args:
            to_surface: maps rays (x, y, 1) to (s, t, 1), each 0 to 1 across the surface, (3, 3).
            ray: (x, y), where to compare their sizes.
            scale: image pixels in a normalised unit.
        """
        s, t, w = (to_surface[:, :2] @ ray + to_surface[:, 2]).tolist()
        # Derivative of (s, t) by the normalised coordinates.
        slope = (to_surface[:2, :2] - np.array([[s], [t]]) / w * to_surface[2, :2]) / w
        footprint = np.hypot(slope[:, 0], slope[:, 1]) / scale
        shape = self._levels[0, 0].shape
        texels = np.clip(footprint * shape[::-1], 1.0, min(shape) / 2.0)
        across, along = np.round(np.log2(texels)).astype(int).tolist()
        texture = self._level(across, along)
        rows, columns = texture.shape
        # Texture pixel (0, 0) has its centre half a pixel inside the corner.
        to_pixel = np.array([[columns, 0.0, -0.5], [0.0, rows, -0.5], [0.0, 0.0, 1.0]])
        return texture, to_pixel @ to_surface

    def _level(self, across: int, along: int) -> Texture:
        key = across, along
        if key not in self._levels:
            finer = self._level(across - 1, along) if across else self._level(across, along - 1)
            shape = self._levels[0, 0].shape
            size = -(-shape[1] // 2**across), -(-shape[0] // 2**along)
            self._levels[key] = np.asarray(cv2.resize(finer, size, interpolation=cv2.INTER_AREA))
        return self._levels[key]
