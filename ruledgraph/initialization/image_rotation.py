# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""How a camera turned between two images, from points followed from one to the other.

With the right rotation R between two images the normals of the epipolar planes, a x R b for the
rays a and b of one point, are perpendicular to one direction d, that of the translation (Kneip and
Lynen, ICCV 2013). What a point is off,

    e = d . (a x R b) / sqrt((|d x a|^2 + |d x R b|^2) / 2),

is its distance from the epipolar plane, the mean over both images. Of each pair of images there
remains, d eliminated, a quadratic function of R: all that it says about how the camera turned.
Where the translation could explain the points as well, its information is small of itself.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray

# Points followed, and the fewest that say anything: five are the least for rotation and direction.
_POINTS, _MIN_POINTS = 100, 20
POINT_SIGMA = 0.2
"""Standard deviation of a followed point, px; what is left over says better."""
# Followed there and back a point returns to where it was, px.
_RETURNS = 1.0
# Cauchy's constant for an efficiency of 95 %, and the median's share of a standard deviation.
_CAUCHY, _MEDIAN = 2.385, 0.6745
# A point this close to the translation's direction, of 1, has no epipolar plane.
_EPIPOLE = 0.05


class PointPairs(NamedTuple):
    """Rays of the same points in two images each."""

    times: FloatArray
    """Of both images, (P, 2), s."""
    before: FloatArray
    """Unit vectors in the camera, (P, n, 3); rays that are missing are zero."""
    after: FloatArray


class RotationEvidence(NamedTuple):
    """What pairs of images say of how the camera turned between them, about given rotations.

    Turning by Exp(delta) Exp(turn) instead costs `-2 gradient.delta + delta.information.delta`
    more, rotation vectors in the axes of the camera before. In units of `POINT_SIGMA`'s variance.
    """

    costs: FloatArray
    """Of these rotations, squared and with a Cauchy loss, (P,)."""
    gradient: FloatArray
    """(P, 3), 1/rad."""
    information: FloatArray
    """(P, 3, 3), 1/rad^2."""


def tracked_rays(
    before: NDArray[np.uint8], after: NDArray[np.uint8], camera: CameraModel
) -> tuple[FloatArray, FloatArray] | None:
    """Unit rays of points followed from one image to another, (n, 3) each, padded with zeros.

    None where too few can be followed.
    """
    corners = cv2.goodFeaturesToTrack(before, _POINTS, 0.01, camera.width / 40.0)
    if corners is None or len(corners) < _MIN_POINTS:
        return None
    found, status, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, np.empty_like(corners))
    back, _, _ = cv2.calcOpticalFlowPyrLK(after, before, found, np.empty_like(corners))
    kept = (status.ravel() == 1) & (np.abs(back - corners).max(axis=(1, 2)) < _RETURNS)
    rays = []
    for points in (corners, found):
        normalised = camera.undistort(points[:, 0].astype(np.float64))
        ray = np.hstack([normalised, np.ones((len(normalised), 1))])
        rays.append(ray / np.linalg.norm(ray, axis=1, keepdims=True))
    kept &= np.isfinite(rays[0]).all(axis=1) & np.isfinite(rays[1]).all(axis=1)
    if kept.sum() < _MIN_POINTS:
        return None
    padding = ((0, _POINTS - int(kept.sum())), (0, 0))
    return np.pad(rays[0][kept], padding), np.pad(rays[1][kept], padding)


def rotation_evidence(
    pairs: PointPairs, rotations: FloatArray, focal_length: float
) -> RotationEvidence:
    """What pairs say about rotations, the directions of the translations eliminated.

    Args:
        pairs: P of them.
        rotations: rotation vectors of the camera from before to after, (P, 3), rad.
        focal_length: px.
    """
    turned, normals, axes, sizes, errors = _geometry(pairs, rotations, focal_length)
    there = pairs.before[..., 2] > 0.0
    scale = POINT_SIGMA / focal_length
    r = errors / scale
    direction = axes[:, None, :, 0]
    # d . (a x (delta x R b)) = delta . (R b x (d x a)).
    by_rotation = np.cross(turned, np.cross(direction, pairs.before))
    by_direction = np.einsum("pni,pij->pnj", normals, axes[:, :, 1:])
    J = np.concatenate([by_rotation, by_direction], axis=2) / (sizes * scale)[..., None]
    weighted = J * (there * _weights(r))[..., None]
    N = np.einsum("pni,pnj->pij", weighted, J)
    g = -np.einsum("pni,pn->pi", weighted, r)
    # Without translation nearly nothing is known of its direction.
    corner = N[:, 3:, 3:] + 1e-9 * np.trace(N, axis1=1, axis2=2)[:, None, None] * np.eye(2)
    gain = np.linalg.solve(corner, N[:, 3:, :3]).transpose(0, 2, 1)
    return RotationEvidence(
        _CAUCHY**2 * np.sum(there * np.log1p((r / _CAUCHY) ** 2), axis=1),
        g[:, :3] - np.einsum("pij,pj->pi", gain, g[:, 3:]),
        N[:, :3, :3] - gain @ N[:, 3:, :3],
    )


def epipolar_error(pairs: PointPairs, rotations: FloatArray, focal_length: float) -> float:
    """How far points are from their epipolar planes: 1.48 times the median, px."""
    errors = _geometry(pairs, rotations, focal_length).errors[pairs.before[..., 2] > 0.0]
    return float(np.median(np.abs(errors))) / _MEDIAN * focal_length


class _Geometry(NamedTuple):
    turned: FloatArray
    """R b, (P, n, 3)."""
    normals: FloatArray
    """(P, n, 3)."""
    axes: FloatArray
    """The direction of the translation and two across it, as columns, (P, 3, 3)."""
    sizes: FloatArray
    """What an error is divided by, (P, n)."""
    errors: FloatArray
    """e, (P, n), rad."""


def _geometry(pairs: PointPairs, rotations: FloatArray, focal_length: float) -> _Geometry:
    R = np.array([cv2.Rodrigues(turn)[0] for turn in rotations])
    turned = np.einsum("pij,pnj->pni", R, pairs.after)
    normals = np.cross(pairs.before, turned)
    weights = (pairs.before[..., 2] > 0.0).astype(np.float64)
    # With the sizes the direction changes a little, and they with it.
    for _ in range(2):
        scatter = np.einsum("pn,pni,pnj->pij", weights, normals, normals)
        _, axes = np.linalg.eigh(scatter)
        direction = axes[:, None, :, 0]
        across = [np.cross(direction, rays) for rays in (pairs.before, turned)]
        squared = np.sum(across[0] ** 2 + across[1] ** 2, axis=-1) / 2.0
        sizes = np.sqrt(np.maximum(squared, _EPIPOLE**2))
        errors = np.sum(normals * direction, axis=-1) / sizes
        there = pairs.before[..., 2] > 0.0
        weights = there * _weights(errors * focal_length / POINT_SIGMA) / sizes**2
    return _Geometry(turned, normals, axes, sizes, errors)


def _weights(r: FloatArray) -> FloatArray:
    """Of residuals in standard deviations."""
    return np.asarray(1.0 / (1.0 + (r / _CAUCHY) ** 2))
