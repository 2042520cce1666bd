# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Straight segments in one image, where new lines start."""

from collections.abc import Callable, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.arrays import FloatArray
from ruledgraph.frontend.sobel import sobel_points

Detector = Callable[[NDArray[np.uint8]], FloatArray]

# The paper's Hough transform: rho 5 px, theta 1 degree, threshold 100, minimum length 100 px,
# largest gap 5 px; the strongest line's points are removed and the transform repeated.
_HOUGH_ROUNDS = 20
_HOUGH_REMOVE = 5
# By so many steps of strength LSD orders the pixels from which its segments grow. Its own 1024 find
# as many segments in a fifth more time; with 16 it finds them on wide blurred edges too.
_LSD_STEPS = 64


def detect_lsd(image: NDArray[np.uint8]) -> FloatArray:
    """Segments by OpenCV's line segment detector (von Gioi et al. 2010), ends in px, (N, 2, 2)."""
    # Unrefined: what is not straight fails the search for its edge points, which costs less.
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_NONE, n_bins=_LSD_STEPS)
    found = detector.detect(image)[0]
    return np.zeros((0, 2, 2)) if found is None else np.asarray(found, float).reshape(-1, 2, 2)


def detect_hough(image: NDArray[np.uint8]) -> FloatArray:
    """Segments by the paper's iterated probabilistic Hough transform, ends in px, (N, 2, 2)."""
    points = sobel_points(image).astype(np.uint8) * 255
    segments: list[FloatArray] = []
    for _ in range(_HOUGH_ROUNDS):
        found = cv2.HoughLinesP(points, 5, np.pi / 180, 100, minLineLength=100, maxLineGap=5)
        if found is None:
            break
        ends = np.asarray(found, float).reshape(-1, 2, 2)
        strongest = ends[int(np.argmax(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))]
        segments.append(strongest)
        a, b = (tuple(int(c) for c in end) for end in strongest)
        cv2.line(points, a, b, 0, 2 * _HOUGH_REMOVE + 1)
    return np.array(segments).reshape(-1, 2, 2)


DETECTORS: Mapping[str, Detector] = {"lsd": detect_lsd, "hough": detect_hough}
"""By their name in the configuration."""
