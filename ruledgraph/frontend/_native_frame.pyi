# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""What is done in every frame, natively: `native/native_frame.cpp`; internal.

Arrays are C-contiguous. Sizes that do not fit together, an unknown distortion model or a sigma that
is not from 0 to 1000 px raise ValueError; types and shapes that do not fit the signature raise
TypeError.
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ruledgraph.core.arrays import FloatArray

_Found: TypeAlias = tuple[
    NDArray[np.int64],
    FloatArray,
    FloatArray,
    FloatArray,
    FloatArray,
    FloatArray,
    FloatArray,
    FloatArray,
    NDArray[np.bool_],
]

class Camera:
    """A `CameraModel`."""

    def __init__(
        self,
        width: int,
        height: int,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        distortion: str,
        coefficients: Sequence[float],
    ) -> None:
        """Take the fields of a `CameraModel`, in their order."""

class SearchSettings:
    """Of `EdgesConfig`, and `BORDER_PX`."""

    def __init__(
        self,
        station_distance_px: float,
        max_stations: int,
        min_points: int,
        min_support: float,
        min_extent: float,
        min_slope: float,
        min_slope_share: float,
        stripe_px: int,
        stripe_share: float,
        vote_px: float,
        inlier_px: float,
        sigma_penalty: float,
        rival_distance_px: float,
        rival_share: float,
        end_growth: float,
        border_px: float,
    ) -> None:
        """Take these fields of an `EdgesConfig`."""

def gradient(image: NDArray[np.uint8], xy: NDArray[np.float32], blur: float) -> None:
    """Write `gradient_by_opencv` of an image (height, width) into xy, (height, width, 2); `blur` is
    the blur's deviation, px.
    """

def search_all(
    gradient: NDArray[np.float32],
    camera: Camera,
    settings: SearchSettings,
    ends: FloatArray,
    sigmas: FloatArray,
    slopes: FloatArray,
    beyond: float,
    bows: FloatArray | None = None,
) -> _Found:
    """Search n rulings: `search` of each, as the fields of `Edges` in their order, a row for each;
    ends are (n, 4), statistics (n, 9).

    `gradient` is (height, width, 2), `ends` (n, 2, 2), `sigmas` (n, 2), `slopes` (n,), `bows`
    (n, 2).
    """

def predict_all(
    plucker: FloatArray,
    by_delta: FloatArray,
    covariances: FloatArray,
    seen: FloatArray,
    floors: FloatArray,
    world_T_before: FloatArray,
    world_T_cam: FloatArray,
    ends: FloatArray,
    sigmas: FloatArray,
    focal: float,
    max_sigma: float,
    nearest: float,
) -> tuple[FloatArray, FloatArray]:
    """`prediction.predict_in_numpy` of n lines; the poses are (4, 4).

    Ends (n, 4) and sigmas (n, 2).
    """

def rotate_all(ends: FloatArray, cam_R_before: FloatArray, moved: FloatArray) -> FloatArray:
    """`prediction.rotate_in_numpy` of n segments, (n, 4)."""

def clip_all(
    ends: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """`batch.clip_in_numpy` of n segments: parts (n, 4) and which are in view (n,)."""
