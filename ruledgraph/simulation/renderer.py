# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Images of a scene, faithful to a small fraction of a pixel.

Every pixel's own ray, distortion included, is intersected with the planes of the surfaces: nothing
is warped twice. Textures are averaged over the pixel, separately along their two axes, so that a
wall seen aslant stays sharp across. Where a surface ends, a pixel gets the share that its distance
from the projected border leaves to each side, exact for a straight border.
"""

from typing import NamedTuple

import cv2
import gtsam
import numpy as np
from numpy.typing import NDArray

from ruledgraph.errors import RuledgraphError
from ruledgraph.sensors import CameraModel
from ruledgraph.simulation.motion import FloatArray
from ruledgraph.simulation.occlusion import CUT, FREE, PaintersOrder
from ruledgraph.simulation.scene import Scene, Texture

Image = NDArray[np.float32]

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


class _View(NamedTuple):
    """The rectangle of the image that a surface may touch."""

    rows: slice
    columns: slice
    x: Image
    """Normalised coordinates of its pixels; x and y broadcast to its shape."""
    y: Image
    scale: Image
    """Pixels in one normalised unit."""


class _Boxes(NamedTuple):
    """Bounding boxes of n fragments, clipped to the image."""

    low: FloatArray
    """Smallest and largest normalised coordinates, (n, 2) each."""
    high: FloatArray
    pixels: NDArray[np.int64]
    """First row, row behind the last, first column, column behind the last, (n, 4)."""


class Renderer:
    """Draws one scene for one camera.

    Raises:
        RuledgraphError: for a camera whose distortion has no inverse somewhere in the image.
    """

    def __init__(self, scene: Scene, camera: CameraModel) -> None:
        self._camera = camera
        self._textures = [_Pyramid(texture) for texture in scene.textures]
        self._corners = np.array([surface.corner for surface in scene.surfaces])
        self._sides = np.array([[s.right, s.down] for s in scene.surfaces])
        self._normals = np.array([surface.normal for surface in scene.surfaces])
        self._order = PaintersOrder(scene.surfaces)
        fragments = self._order.fragments
        self._surface_of = np.array([fragment.surface for fragment in fragments])
        self._vertices = np.concatenate([fragment.vertices for fragment in fragments])
        stops = np.cumsum([len(fragment.vertices) for fragment in fragments])
        self._starts = np.concatenate([[0], stops[:-1]])
        self._spans = [slice(*span) for span in zip(self._starts, stops, strict=True)]
        self._fragment_of = np.repeat(np.arange(len(fragments)), np.diff([0, *stops]))
        # The vertex after each.
        self._next = np.arange(1, len(self._vertices) + 1)
        self._next[stops - 1] = self._starts
        self._prepare_rays()

    def _prepare_rays(self) -> None:
        camera = self._camera
        u, v = np.arange(camera.width), np.arange(camera.height)
        if camera.distortion == "none":
            self._x = ((u[None, :] - camera.cx) / camera.fx).astype(np.float32)
            self._y = ((v[:, None] - camera.cy) / camera.fy).astype(np.float32)
            self._scale = np.full((1, 1), np.sqrt(camera.fx * camera.fy), dtype=np.float32)
        else:
            rays = camera.undistort(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
            if not np.all(np.isfinite(rays)):
                raise RuledgraphError("the camera's distortion has no inverse in all of the image")
            shape = camera.height, camera.width
            self._x, self._y = rays.T.reshape(2, *shape).astype(np.float32)
            area = np.linalg.det(camera.distort(rays).jacobian)
            self._scale = np.sqrt(area).reshape(shape).astype(np.float32)
        self._field = np.array([[a.min(), a.max()] for a in (self._x, self._y)]).T.astype(float)
        # Inward normals of the planes that bound the field of view, with a margin for surfaces
        # that cover part of a border pixel.
        margin = _MARGIN / camera.focal_length
        (left, top), (right, bottom) = self._field + [[-margin], [margin]]
        self._field_planes = np.array(
            [[0, 0, 1], [1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]], dtype=float
        )

    def render(self, world_T_cam: gtsam.Pose3) -> Image:
        """Brightness of every pixel, 0 to 255, (height, width)."""
        eye, world_R_cam = world_T_cam.translation(), world_T_cam.rotation().matrix()
        in_cam = (self._vertices - eye) @ world_R_cam
        following = in_cam[self._next]
        inside = in_cam @ self._field_planes.T - [_NEAR, 0.0, 0.0, 0.0, 0.0]
        faces_eye = np.sum((eye - self._corners) * self._normals, axis=1) > 1e-6
        visible = np.all(np.maximum.reduceat(inside, self._starts) > 0.0, axis=1)
        visible &= faces_eye[self._surface_of]
        boxes = self._boxes(in_cam)
        visible &= (boxes.pixels[:, 0] < boxes.pixels[:, 1]) & (
            boxes.pixels[:, 2] < boxes.pixels[:, 3]
        )

        # A point of a surface is corner + s right + t down = eye + depth * ray, so (s, t, 1) is
        # proportional to the inverse of [right, down, corner - eye] times the ray.
        columns = np.concatenate([self._sides, (self._corners - eye)[:, None]], axis=1)
        columns[~faces_eye] = np.eye(3)
        maps = np.linalg.inv(columns.transpose(0, 2, 1)) @ world_R_cam
        # The plane through the eye and an edge tells the two sides of its image apart, even where
        # the edge reaches behind the camera. Vertices are clockwise, hence inside is positive.
        planes = np.cross(in_cam, in_cam[self._next])
        planes /= np.linalg.norm(planes[:, :2], axis=1, keepdims=True) + 1e-12
        partial = self._partial(planes, boxes)
        planes = planes.astype(np.float32)

        canvas = np.zeros((self._camera.height, self._camera.width), dtype=np.float32)
        painted = ~faces_eye
        for index in self._order.seen_from(eye):
            if not visible[index]:
                continue
            surface, span = int(self._surface_of[index]), self._spans[index]
            view = self._view(boxes.pixels[index].tolist())
            ray = (*(0.5 * (boxes.low[index] + boxes.high[index])).tolist(), 1.0)
            pixels = _sample(self._textures[surface], view, maps[surface], ray)
            edges = self._order.fragments[index].edges
            cover = None
            for vertex, edge in zip(range(span.start, span.stop), edges, strict=True):
                if partial[vertex]:
                    kept = _inside(planes[vertex], view, edge, bool(painted[edge]))
                    cover = kept if cover is None else np.minimum(cover, kept, out=cover)
            part = canvas[view.rows, view.columns]
            if cover is None:
                part[...] = pixels
            else:
                part += cover * (pixels - part)
            painted[surface] = True
        return canvas

    def _boxes(self, in_cam: FloatArray) -> _Boxes:
        """Bounding boxes of all fragments, from their vertices in the camera frame."""
        camera = self._camera
        with np.errstate(divide="ignore", invalid="ignore"):
            normalised = in_cam[:, :2] / in_cam[:, 2:]
        low = np.minimum.reduceat(normalised, self._starts)
        high = np.maximum.reduceat(normalised, self._starts)
        behind = in_cam[:, 2] < _NEAR
        for index in np.flatnonzero(np.logical_or.reduceat(behind, self._starts)):
            in_front = _in_front(in_cam[self._spans[index]])
            rays = in_front[:, :2] / in_front[:, 2:] if len(in_front) else np.zeros((1, 2))
            low[index], high[index] = rays.min(axis=0), rays.max(axis=0)
        low, high = np.clip(low, *self._field), np.clip(high, *self._field)
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
        margin = (_MARGIN + 1.0) / self._camera.focal_length
        corner = np.where(
            planes[:, :2] > 0.0,
            (boxes.low - margin)[self._fragment_of],
            (boxes.high + margin)[self._fragment_of],
        )
        least = np.sum(planes[:, :2] * corner, axis=1) + planes[:, 2]
        return np.asarray(least * float(self._scale.min()) < 0.5)

    def _view(self, pixels: list[int]) -> _View:
        rows, columns = slice(*pixels[:2]), slice(*pixels[2:])
        if self._camera.distortion == "none":
            return _View(rows, columns, self._x[:, columns], self._y[rows], self._scale)
        part = rows, columns
        return _View(*part, self._x[part], self._y[part], self._scale[part])


def _in_front(polygon: FloatArray) -> FloatArray:
    """The part of a polygon (k, 3) in front of the camera."""
    kept = []
    for start, stop in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if start[2] >= _NEAR:
            kept.append(start)
        if (start[2] >= _NEAR) != (stop[2] >= _NEAR):
            kept.append(start + (_NEAR - start[2]) / (stop[2] - start[2]) * (stop - start))
    return np.array(kept)


def _linear(h: NDArray[np.float32], view: _View) -> Image:
    return np.asarray(h[0] * view.x + (h[1] * view.y + h[2]))


def _sample(
    pyramid: "_Pyramid", view: _View, H: FloatArray, middle: tuple[float, float, float]
) -> Texture:
    """A texture at every pixel of the view.

    Args:
        pyramid: the texture.
        view: the pixels.
        H: maps rays (x, y, 1) to (s, t, 1), each 0 to 1 across the texture.
        middle: the ray to choose the texture's resolution at.
    """
    s, t, w = (H @ middle).tolist()
    # Derivative of (s, t) by the normalised coordinates.
    slope = (H[:2, :2] - np.array([[s], [t]]) / w * H[2, :2]) / w
    texture = pyramid.level(np.hypot(slope[:, 0], slope[:, 1]) / float(view.scale[0, 0]))
    rows, columns = texture.shape
    # Texture pixel (0, 0) has its centre half a pixel inside the corner.
    to_pixel = np.array([[columns, 0.0, -0.5], [0.0, rows, -0.5], [0.0, 0.0, 1.0]])
    h = (to_pixel @ H).astype(np.float32)
    depth = np.maximum(_linear(h[2], view), np.float32(1e-6))
    column, row = _linear(h[0], view), _linear(h[1], view)
    column /= depth
    row /= depth
    sampled = cv2.remap(texture, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled)


def _inside(plane: NDArray[np.float32], view: _View, edge: int, is_painted: bool) -> Image:
    """Share of each pixel on the inner side of an edge.

    Args:
        plane: distance from the edge when applied to (x, y, 1), positive inside.
        view: the pixels.
        edge: what is beyond, see `Fragment`.
        is_painted: the surface beyond is painted already, or faces away.
    """
    distance = _linear(plane, view)
    distance *= view.scale
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

    def level(self, footprint: FloatArray) -> Texture:
        """The texture whose pixels are about as large as an image pixel.

        Args:
            footprint: extent of an image pixel on the surface, as a share of its width and height.
        """
        shape = self._levels[0, 0].shape
        texels = footprint * [shape[1], shape[0]]
        wanted = np.round(np.log2(np.clip(texels, 1.0, min(shape) / 2.0)))
        return self._at(int(wanted[0]), int(wanted[1]))

    def _at(self, across: int, along: int) -> Texture:
        key = across, along
        if key not in self._levels:
            finer = self._at(across - 1, along) if across else self._at(across, along - 1)
            shape = self._levels[0, 0].shape
            size = -(-shape[1] // 2**across), -(-shape[0] // 2**along)
            self._levels[key] = np.asarray(cv2.resize(finer, size, interpolation=cv2.INTER_AREA))
        return self._levels[key]
