# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the images turn as the gyroscope says: is the mounting the right way round, the clock?

Points are followed over pairs of frames. With the right rotation between two frames the normals of
their epipolar planes are perpendicular to one direction, that of the translation, whatever it is
(Kneip and Lynen, ICCV 2013). How far they are from that judges a mounting and a time offset.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import cv2
import numpy as np

from ruledgraph.calibration.sensors import Calibration, CameraModel, FloatArray
from ruledgraph.core.measurements import Frame, ImuSample, Measurement
from ruledgraph.diagnostics.checks import Finding

# Pairs of frames, s between their frames, and points in each.
_MOST_PAIRS, _FEWEST_PAIRS, _APART, _POINTS, _FEWEST_POINTS = 80, 20, 0.06, 100, 20
# Turning (rad/s, root mean square) without which nothing can be said.
_LEAST_TURNING = 0.05
# Another mounting must explain the points so much better to be believed, and another offset.
_BETTER, _BETTER_OFFSET = 0.7, 0.93
_OFFSETS = np.arange(-0.1, 0.1001, 0.0025)
_LARGE_OFFSET = 0.012
# Of a point, px: those that are further off count less.
_LOSS = 2.0


class _Pairs(NamedTuple):
    """Rays of the same points in two frames."""

    times: FloatArray
    """Of both frames, (P, 2), s."""
    before: FloatArray
    """(P, n, 3); rays that are missing are zero."""
    after: FloatArray


def examine_turning(
    measurements: Iterable[Measurement], calibration: Calibration
) -> Iterator[Finding]:
    """Compare the turning of the images with the gyroscope's.

    Args:
        measurements: a stretch of a recording; the first of it that suffices is used.
        calibration: to judge.
    """
    stamps, gyroscope = [], []
    pairs: list[tuple[int, int, FloatArray, FloatArray]] = []
    before: Frame | None = None
    camera = calibration.camera
    for m in measurements:
        if isinstance(m, ImuSample):
            stamps.append(m.stamp)
            gyroscope.append(m.gyroscope)
        elif isinstance(m, Frame):
            if m.image.shape != (camera.height, camera.width) or len(pairs) >= _MOST_PAIRS:
                break
            if before is not None and m.stamp - before.stamp < _APART * 1e9:
                continue
            rays = _rays(before, m, camera) if before is not None else None
            if before is not None and rays is not None:
                pairs.append((before.stamp, m.stamp, *rays))
            before = m
    if len(pairs) < _FEWEST_PAIRS or len(stamps) < 2:
        return
    times = (np.array([p[:2] for p in pairs]) - stamps[0]) * 1e-9
    stacked = _Pairs(times, np.array([p[2] for p in pairs]), np.array([p[3] for p in pairs]))
    yield from _judge(
        stacked, (np.array(stamps) - stamps[0]) * 1e-9, np.array(gyroscope), calibration
    )


def _judge(
    pairs: _Pairs, at: FloatArray, gyroscope: FloatArray, calibration: Calibration
) -> Iterator[Finding]:
    angles = np.zeros_like(gyroscope)
    mean = 0.5 * (gyroscope[1:] + gyroscope[:-1])
    angles[1:] = np.cumsum(mean * np.diff(at)[:, None], axis=0)
    lengths = pairs.times[:, 1] - pairs.times[:, 0]
    focal = calibration.camera.focal_length

    def turns(offset: float) -> FloatArray:
        """Of the body between the frames of each pair, (P, 3), rad."""
        ends = [
            np.stack([np.interp(t + offset, at, angle) for angle in angles.T], axis=1)
            for t in pairs.times.T
        ]
        return np.asarray(ends[1] - ends[0])

    def off(body_R_cam: FloatArray, bias: FloatArray, offset: float) -> float:
        """Root mean square, px."""
        in_cam = (turns(offset) - bias * lengths[:, None]) @ body_R_cam
        return focal * _epipolar_error(pairs, in_cam, _LOSS / focal)

    said, offset = calibration.body_T_cam.rotation().matrix(), calibration.time_offset
    turning = turns(offset)
    bias = np.median(turning / lengths[:, None], axis=0)
    if np.sqrt(np.mean(np.sum((turning / lengths[:, None] - bias) ** 2, axis=1))) < _LEAST_TURNING:
        return
    found = _with_bias(off, said, offset)
    others = [_with_bias(off, R, offset) for R in (*_other_ways(said), said.T)]
    best = min(others, key=lambda other: other[0])
    if best[0] < _BETTER * found[0]:
        yield Finding(
            False,
            f"points miss the gyroscope's turning by {found[0]:.2g} px, and by {best[0]:.2g} px "
            "with another mounting; is T_cam_imu the right way round, and of this camera?",
        )
        return
    yield Finding(True, f"the images turn as the gyroscope says, to {found[0]:.2g} px")
    tried = [off(said, found[1], float(other)) for other in _OFFSETS]
    other = float(_OFFSETS[int(np.argmin(tried))])
    if abs(other - offset) > _LARGE_OFFSET and min(tried) < _BETTER_OFFSET * found[0]:
        yield Finding(
            False,
            f"the images fit the gyroscope best {1e3 * other:.0f} ms later, the calibration says "
            f"{1e3 * offset:.0f} ms; calibrate the time offset",
        )


def _with_bias(
    off: Callable[[FloatArray, FloatArray, float], float], body_R_cam: FloatArray, offset: float
) -> tuple[float, FloatArray]:
    """The least error over the gyroscope's bias, and that bias."""
    from scipy.optimize import minimize

    found = minimize(
        lambda bias: off(body_R_cam, bias, offset),
        np.zeros(3),
        method="Nelder-Mead",
        options={"maxfev": 60, "initial_simplex": 0.05 * np.vstack([np.zeros(3), np.eye(3)])},
    )
    return float(found.fun), np.asarray(found.x)


def _other_ways(said: FloatArray) -> Iterator[FloatArray]:
    """The other 23 mountings with the camera's axes exchanged."""
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.eye(3)[list(order)] * signs
            if np.linalg.det(R) > 0.0 and not np.allclose(R, np.eye(3)):
                yield said @ R


def _epipolar_error(pairs: _Pairs, turns: FloatArray, loss: float) -> float:
    """How far the normals of epipolar planes are from a common plane, root mean square, rad.

    Args:
        pairs: what was followed.
        turns: rotation vectors of the camera from before to after, in its axes, (P, 3).
        loss: an error that counts half.
    """
    R = np.array([cv2.Rodrigues(turn)[0] for turn in turns])
    normals = np.cross(pairs.before, np.einsum("pij,pnj->pni", R, pairs.after))
    _, directions = np.linalg.eigh(np.einsum("pni,pnj->pij", normals, normals))
    errors = np.einsum("pni,pi->pn", normals, directions[:, :, 0]) ** 2
    there = pairs.before[..., 2] > 0.0
    robust = errors / (1.0 + errors / loss**2)
    return float(np.sqrt(robust[there].mean()))


def _rays(before: Frame, after: Frame, camera: CameraModel) -> tuple[FloatArray, FloatArray] | None:
    """Unit rays of points followed from one frame to another, (n, 3) each, padded with zeros."""
    corners = cv2.goodFeaturesToTrack(before.image, _POINTS, 0.01, camera.width / 40.0)
    if corners is None or len(corners) < _FEWEST_POINTS:
        return None
    followed, status, _ = cv2.calcOpticalFlowPyrLK(
        before.image, after.image, corners, np.empty_like(corners)
    )
    back, _, _ = cv2.calcOpticalFlowPyrLK(
        after.image, before.image, followed, np.empty_like(corners)
    )
    kept = (status.ravel() == 1) & (np.abs(back - corners).max(axis=(1, 2)) < 1.0)
    rays = []
    for points in (corners, followed):
        normalised = camera.undistort(points[:, 0].astype(np.float64))
        ray = np.hstack([normalised, np.ones((len(normalised), 1))])
        rays.append(ray / np.linalg.norm(ray, axis=1, keepdims=True))
    kept &= np.isfinite(rays[0]).all(axis=1) & np.isfinite(rays[1]).all(axis=1)
    if kept.sum() < _FEWEST_POINTS:
        return None
    padding = ((0, _POINTS - int(kept.sum())), (0, 0))
    return np.pad(rays[0][kept], padding), np.pad(rays[1][kept], padding)
