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
# Steps along an edge that distortion bends.
_BENDS = np.linspace(0.0, 1.0, 8, endpoint=False)[:, None]


class _View(NamedTuple):
    """The rectangle of the image that a surface may touch."""

    rows: slice
    columns: slice
    x: Image
    """Normalised coordinates of its pixels; x and y broadcast to its shape."""
    y: Image
    scale: Image
    """Pixels in one normalised unit."""
    bounds: tuple[FloatArray, FloatArray]
    """Smallest and largest (x, y)."""


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
        self._vertices = np.concatenate([fragment.vertices for fragment in fragments])
        self._ends = np.cumsum([len(fragment.vertices) for fragment in fragments])
        self._starts = np.concatenate([[0], self._ends[:-1]])
        self._surface_of = np.array([fragment.surface for fragment in fragments])
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
                raise RuledgraphError("the camera's distortion folds over inside the image")
            shape = camera.height, camera.width
            self._x, self._y = rays.T.reshape(2, *shape).astype(np.float32)
            area = np.linalg.det(camera.distort(rays).jacobian)
            self._scale = np.sqrt(area).reshape(shape).astype(np.float32)
        # The field of view has a margin for surfaces that cover part of a border pixel.
        margin = 2.0 / camera.focal_length
        left, right = float(self._x.min()) - margin, float(self._x.max()) + margin
        top, bottom = float(self._y.min()) - margin, float(self._y.max()) + margin
        # Inward normals of the planes that bound it; a point is inside when n . P > offset.
        self._field = np.array(
            [[0, 0, 1], [1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]], dtype=float
        )
        self._field_offset = np.array([_NEAR, 0.0, 0.0, 0.0, 0.0])

    def render(self, world_T_cam: gtsam.Pose3) -> Image:
        """Brightness of every pixel, 0 to 255, (height, width)."""
        eye, world_R_cam = world_T_cam.translation(), world_T_cam.rotation().matrix()
        canvas = np.zeros((self._camera.height, self._camera.width), dtype=np.float32)
        in_cam = (self._vertices - eye) @ world_R_cam
        inside = in_cam @ self._field.T - self._field_offset
        faces_eye = np.sum((eye - self._corners) * self._normals, axis=1) > _NEAR * 1e-3
        in_field = np.all(np.maximum.reduceat(inside, self._starts) > 0.0, axis=1)
        visible = in_field & faces_eye[self._surface_of]
        cut_by_field = np.any(np.minimum.reduceat(inside, self._starts) < 0.0, axis=1)
        painted = ~faces_eye
        for index in self._order.seen_from(eye):
            surface = int(self._surface_of[index])
            if not visible[index]:
                continue
            polygon = in_cam[self._starts[index] : self._ends[index]]
            seen = self._clip(polygon) if cut_by_field[index] else polygon
            view = self._view(seen) if len(seen) else None
            if view is not None:
                edges = self._order.fragments[index].edges
                cover = _coverage(view, polygon, edges, painted)
                pixels = self._sample(view, seen.mean(axis=0), surface, eye, world_R_cam)
                part = canvas[view.rows, view.columns]
                if cover is None:
                    part[...] = pixels
                else:
                    part += cover * (pixels - part)
            painted[surface] = True
        return canvas

    def _clip(self, polygon: FloatArray) -> FloatArray:
        """The part of a polygon (k, 3) in the field of view; Sutherland and Hodgman."""
        for normal, offset in zip(self._field, self._field_offset, strict=True):
            height = polygon @ normal - offset
            if height.min() >= 0.0:
                continue
            following, next_height = np.roll(polygon, -1, axis=0), np.roll(height, -1)
            clipped = []
            for i in range(len(polygon)):
                if height[i] >= 0.0:
                    clipped.append(polygon[i])
                if (height[i] >= 0.0) != (next_height[i] >= 0.0):
                    share = height[i] / (height[i] - next_height[i])
                    clipped.append(polygon[i] + share * (following[i] - polygon[i]))
            polygon = np.array(clipped).reshape(-1, 3)
            if not clipped:
                break
        return polygon

    def _view(self, polygon: FloatArray) -> _View | None:
        """The pixels around a polygon in front of the camera, None when there are none."""
        camera = self._camera
        normalised = polygon[:, :2] / polygon[:, 2:]
        bent = camera.distortion != "none"
        if bent:
            following = np.roll(normalised, -1, axis=0)
            steps = _BENDS[:, None] * (following - normalised)
            normalised = (normalised + steps.reshape(-1, *normalised.shape)).reshape(-1, 2)
        pixels = camera.distort(normalised).pixels
        # A bent edge bulges between its steps, and a border pixel lies up to one pixel outside.
        margin = 2.0 if bent else 1.0
        c0, r0 = (int(x) for x in np.maximum(np.ceil(pixels.min(axis=0) - margin), 0.0))
        c1, r1 = (
            int(x)
            for x in np.minimum(
                np.floor(pixels.max(axis=0) + margin) + 1.0, (camera.width, camera.height)
            )
        )
        if c0 >= c1 or r0 >= r1:
            return None
        rows, columns = slice(r0, r1), slice(c0, c1)
        if bent:
            x, y, scale = (a[rows, columns] for a in (self._x, self._y, self._scale))
        else:
            x, y, scale = self._x[:, columns], self._y[rows], self._scale
        return _View(rows, columns, x, y, scale, (_smallest(x, y), -_smallest(-x, -y)))

    def _sample(
        self, view: _View, middle: FloatArray, surface: int, eye: FloatArray, world_R_cam: FloatArray
    ) -> Texture:
        """The surface's texture at every pixel of the view."""
        # A point of the plane is corner + s right + t down = eye + depth * ray, so that (s, t, 1) is
        # proportional to the inverse of [right, down, corner - eye] times the ray.
        right, down = self._sides[surface]
        to_plane = np.linalg.inv(np.stack([right, down, self._corners[surface] - eye], axis=1))
        H = to_plane @ world_R_cam
        pyramid = self._textures[surface]
        # Derivative of (s, t) by the normalised coordinates, at the middle.
        x, y = middle[:2] / middle[2]
        s, t, w = H @ [x, y, 1.0]
        slope = (H[:2, :2] - np.outer([s / w, t / w], H[2, :2])) / w
        texture = pyramid.level(np.linalg.norm(slope, axis=1) / float(view.scale.flat[0]))
        rows, columns = texture.shape
        # Texture pixel (0, 0) has its centre half a pixel inside the corner.
        H[0] = columns * H[0] - 0.5 * H[2]
        H[1] = rows * H[1] - 0.5 * H[2]
        h = H.astype(np.float32)
        depth = np.maximum(_linear(h[2], view), np.float32(1e-6))
        column, row = _linear(h[0], view) / depth, _linear(h[1], view) / depth
        sampled = cv2.remap(texture, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(sampled)


def _smallest(x: Image, y: Image) -> FloatArray:
    """Smallest (x, y): on the border of the view, where distortion is monotonous."""
    return np.array(
        [min(x[:, 0].min(), x[:, -1].min(), x[0].min(), x[-1].min()),
         min(y[0].min(), y[-1].min(), y[:, 0].min(), y[:, -1].min())]
    )  # fmt: skip


def _linear(h: NDArray[np.float32], view: _View) -> Image:
    return np.asarray(h[0] * view.x + (h[1] * view.y + h[2]))


def _coverage(
    view: _View, polygon: FloatArray, edges: tuple[int, ...], painted: NDArray[np.bool_]
) -> Image | None:
    """Share of each pixel that the polygon (k, 3) covers, None for all of all.

    The plane through the eye and an edge tells the two sides of the edge apart, also where the edge
    reaches behind the camera.
    """
    planes = np.cross(polygon, np.roll(polygon, -1, axis=0))
    planes /= np.linalg.norm(planes[:, :2], axis=1, keepdims=True) + 1e-12
    if planes[0] @ polygon.mean(axis=0) < 0.0:
        planes = -planes
    low, high = view.bounds
    scale = float(view.scale.min())
    cover: Image | None = None
    for plane, edge in zip(planes, edges, strict=True):
        if edge == CUT:
            reach = _SEAM
        elif edge == FREE or painted[edge]:
            reach = 0.0
        else:
            reach = _OVERLAP
        least = np.minimum(plane[:2] * low, plane[:2] * high).sum() + plane[2]
        if least * scale + reach > 0.5:
            continue
        distance = _linear(plane.astype(np.float32), view) * view.scale
        distance += np.float32(0.5 + reach)
        if edge == CUT or reach:
            distance = np.asarray(distance >= 0.5, dtype=np.float32)
        cover = distance if cover is None else np.minimum(cover, distance, out=cover)
    return None if cover is None else np.clip(cover, 0.0, 1.0, out=cover)


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
