# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the images turn as the gyroscope does, roughly: is the mounting the right way round?"""

from collections.abc import Iterable, Iterator

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from ruledgraph.measurements import Frame, ImuSample, Measurement
from ruledgraph.recording.doctor import Finding
from ruledgraph.sensors import Calibration, CameraModel, FloatArray

# Pairs of frames, and points in each.
_MOST_PAIRS, _POINTS, _FEWEST_POINTS = 200, 150, 20
# Turning (rad/s, root mean square) without which nothing can be said, about at least two axes.
_LEAST_TURNING, _SECOND_AXIS = 0.1, 0.25
# How much of the turning must agree.
_LEAST_AGREEMENT = 0.7
# Degrees; the camera's way past things nearby looks like a turn, which may cost some twenty.
_WRONG_ANGLE = 45.0
# Offsets of the stamps that are tried, s.
_OFFSETS = np.arange(-0.1, 0.1001, 0.0025)


def examine_turning(
    measurements: Iterable[Measurement], calibration: Calibration
) -> Iterator[Finding]:
    """Compare the turning of images, by points that are followed, with the gyroscope's.

    What the camera's way adds is taken for noise, so only a mounting that is the wrong way round,
    or another camera's, is found.

    Args:
        measurements: a stretch of a recording; a few hundred frames are used.
        calibration: to compare with.
    """
    times, gyroscope = [], []
    pairs: list[tuple[float, float, FloatArray]] = []
    before: Frame | None = None
    camera = calibration.camera
    for m in measurements:
        if isinstance(m, ImuSample):
            times.append(m.stamp)
            gyroscope.append(m.gyroscope)
        elif isinstance(m, Frame):
            if m.image.shape != (camera.height, camera.width) or len(pairs) >= _MOST_PAIRS:
                break
            if before is not None:
                turn = _turn(before, m, camera)
                if turn is not None:
                    seconds = (m.stamp - before.stamp) * 1e-9
                    pairs.append((before.stamp, m.stamp, turn / seconds))
            before = m
    if len(pairs) < _FEWEST_POINTS or len(times) < _FEWEST_POINTS:
        return
    origin = times[0]
    at = (np.array(times) - origin) * 1e-9
    begin, end = ((np.array([p[i] for p in pairs]) - origin) * 1e-9 for i in (0, 1))
    in_cam = np.array([p[2] for p in pairs])
    yield from _compare(at, np.array(gyroscope), begin, end, in_cam, calibration)


def _compare(
    at: FloatArray,
    gyroscope: FloatArray,
    begin: FloatArray,
    end: FloatArray,
    in_cam: FloatArray,
    calibration: Calibration,
) -> Iterator[Finding]:
    # Angles, so that the mean rate between any two times is a difference.
    angles = np.zeros_like(gyroscope)
    middle = 0.5 * (gyroscope[1:] + gyroscope[:-1])
    angles[1:] = np.cumsum(middle * np.diff(at)[:, None], axis=0)

    def mean_rates(offset: float) -> FloatArray:
        ends = [np.stack([np.interp(t + offset, at, a) for a in angles.T], 1) for t in (begin, end)]
        return np.asarray((ends[1] - ends[0]) / (end - begin)[:, None])

    # Without what is constant: the gyroscope's bias.
    ours = in_cam - np.median(in_cam, axis=0)

    def fit(offset: float) -> tuple[float, FloatArray]:
        """How well it agrees, 1 at best, and body_R_cam."""
        theirs = mean_rates(offset)
        theirs = theirs - np.median(theirs, axis=0)
        u, s, vt = np.linalg.svd(theirs.T @ ours)
        sign = np.sign(np.linalg.det(u @ vt))
        s[2] *= sign
        size = np.linalg.norm(theirs) * np.linalg.norm(ours)
        return float(s.sum() / size), np.asarray(u @ np.diag([1.0, 1.0, sign]) @ vt)

    spread = np.linalg.svd(mean_rates(0.0) - mean_rates(0.0).mean(axis=0), compute_uv=False)
    if spread[0] / np.sqrt(len(begin)) < _LEAST_TURNING or spread[1] < _SECOND_AXIS * spread[0]:
        return
    scores = [fit(float(offset))[0] for offset in _OFFSETS]
    best = float(_OFFSETS[int(np.argmax(scores))])
    agreement, body_R_cam = fit(best)
    if agreement < _LEAST_AGREEMENT:
        yield Finding(
            False,
            f"images and gyroscope hardly turn alike (agreement {agreement:.2f}); are they of one "
            "recording, and of one rig?",
        )
        return
    said = calibration.body_T_cam.rotation().matrix()
    angle = float(np.degrees(np.linalg.norm(Rotation.from_matrix(said.T @ body_R_cam).as_rotvec())))
    if angle > _WRONG_ANGLE:
        yield Finding(
            False,
            f"the images turn about axes some {angle:.0f} degrees from where the calibration says; "
            "is T_cam_imu the right way round, and of this camera?",
        )
    else:
        yield Finding(True, "the images turn about the axes that the gyroscope says, roughly")


def _turn(before: Frame, after: Frame, camera: CameraModel) -> FloatArray | None:
    """Rotation of the camera between two frames, in its own axes, as a rotation vector."""
    corners = cv2.goodFeaturesToTrack(before.image, _POINTS, 0.01, camera.width / 40.0)
    if corners is None or len(corners) < _FEWEST_POINTS:
        return None
    guess = np.empty_like(corners)
    found, status, _ = cv2.calcOpticalFlowPyrLK(before.image, after.image, corners, guess)
    kept = status.ravel() == 1
    if kept.sum() < _FEWEST_POINTS:
        return None
    rays = []
    for points in (corners[kept, 0], found[kept, 0]):
        normalised = camera.undistort(points.astype(np.float64))
        ray = np.hstack([normalised, np.ones((len(normalised), 1))])
        rays.append(ray / np.linalg.norm(ray, axis=1, keepdims=True))
    good = np.isfinite(rays[0]).all(axis=1) & np.isfinite(rays[1]).all(axis=1)
    first, second = rays[0][good], rays[1][good]
    weights = np.ones(len(first))
    rotation = np.eye(3)
    for _ in range(8):
        u, _, vt = np.linalg.svd((first * weights[:, None]).T @ second)
        rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        off = np.linalg.norm(second @ rotation.T - first, axis=1)
        # Cauchy weights: near points move by more than the turn.
        weights = 1.0 / (1.0 + (off / (2.0 / camera.focal_length)) ** 2)
    return np.asarray(Rotation.from_matrix(rotation).as_rotvec())
