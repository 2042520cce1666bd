# SPDX-FileCopyrightText: The ruledgraph developers
# SPDX-License-Identifier: BSD-3-Clause
"""Edge points along a predicted ruling.

The prediction is an image segment with a band of uncertainty. At stations along it the image
derivative across it is sampled; its local maxima of the right sign are candidate edge points, and
of all straight lines inside the band the one with most candidates wins. No picture is undistorted
and nothing is compared with another frame: stations and points pass through the camera model.

For all lines of a frame, and natively, see `edge_batch.py`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ruledgraph.calibration.camera_model import CameraModel
from ruledgraph.core.arrays import FloatArray
from ruledgraph.core.config import DEFAULTS, EdgesConfig
from ruledgraph.frontend.gradient import Gradient


class Ruling(NamedTuple):
    """A predicted image segment: ends (2, 2), normalised; standard deviations of the prediction
    across it at both ends, px; and the sign and usual size of the slope across it, grey levels per
    pixel, in the direction of `normal_of`.
    """

    ends: FloatArray
    sigmas: tuple[float, float]
    slope: float
    bow: FloatArray | None = None
    """Of its middle from the straight line between the ends, (2,), normalised, where its image is
    bent: a parabola, as of a rolling shutter that turns."""


class EdgePoints(NamedTuple):
    """What was found along a ruling."""

    points: FloatArray
    """Normalised image coordinates, (N, 2), in order along the ruling."""
    line: tuple[float, float]
    """a and b of the straight line through them: they are a + b s px across the prediction where s
    goes from 0 at its first end to 1 at its second."""
    support: float
    """Share of the stations that have a point."""
    rms_px: float
    """Root mean square distance from the straight line through them, px."""
    slope: float
    """Median slope across the edge, signed."""
    ambiguous: bool
    """Another line in the band has almost as many points."""


def scaled_to(camera: CameraModel, config: EdgesConfig) -> EdgesConfig:
    """The settings as they apply to a camera: how far apart the edges of a thin stripe are, px."""
    angle_px = round(config.stripe_angle * camera.focal_length)
    stripe = min(config.stripe_px, max(config.stripe_blur_px, angle_px))
    return config.model_copy(update={"stripe_px": stripe})


def normal_of(ends: FloatArray) -> FloatArray:
    """Unit normal (..., 2) of segments (..., 2, 2): their direction turned from x towards y."""
    along = ends[..., 1, :] - ends[..., 0, :]
    length = np.hypot(along[..., 0], along[..., 1])
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    return np.asarray(across / np.maximum(length, 1e-12)[..., None])


def fit_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Least squares y = a + b x: a and b."""
    x_mean, y_mean = float(x.mean()), float(y.mean())
    from_mean = x - x_mean
    b = float(from_mean @ y) / float(from_mean @ from_mean)
    return y_mean - b * x_mean, b


def search(
    gradient: Gradient,
    camera: CameraModel,
    ruling: Ruling,
    beyond: float = 0.0,
    config: EdgesConfig = DEFAULTS.edges,
) -> EdgePoints | None:
    """Edge points of one line, None if there is no such line in the band.

    Args:
        gradient: of the image.
        camera: its model.
        ruling: the prediction.
        beyond: how far past both ends to look, as a share of the segment's length.
        config: of edge points.
    """
    spacing, fewest, stripe = config.station_distance_px, config.min_points, config.stripe_px
    ends, normal = ruling.ends, normal_of(ruling.ends)
    border = camera.distort(ends)
    length = float(np.linalg.norm(border.pixels[1] - border.pixels[0]))
    if not (spacing * fewest < length < 4.0 * (camera.width + camera.height)):
        return None
    count = int(min(length * (1.0 + 2.0 * beyond) / spacing, config.max_stations)) + 1
    along = np.linspace(-beyond, 1.0 + beyond, count)
    stations = ends[0] + along[:, None] * (ends[1] - ends[0])
    direction = np.broadcast_to(ends[1] - ends[0], stations.shape)
    if ruling.bow is not None:
        stations = stations + (4.0 * along * (1.0 - along))[:, None] * ruling.bow
        direction = direction + (4.0 - 8.0 * along)[:, None] * ruling.bow
    distorted = camera.distort(stations)
    usable = gradient.inside(distorted.pixels)
    if usable.sum() < fewest:
        return None
    along, stations, direction = along[usable], stations[usable], direction[usable]
    pixels, J = distorted.pixels[usable], distorted.jacobian[usable]
    # Across the ruling's image: perpendicular to J (ends[1] - ends[0]).
    tangent = np.einsum("nij,nj->ni", J, direction)
    across = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    across *= np.sign(np.einsum("ni,nij,j->n", across, J, normal))[:, None]

    sigma = np.array(ruling.sigmas)
    half = int(np.ceil(3.0 * sigma.max())) + 1
    # Sampled further than maxima are looked for: a stripe's other edge may lie outside the band.
    steps = np.arange(-half - 1 - stripe, half + 2 + stripe)
    at = pixels[:, None] + steps[:, None] * across[:, None]
    slopes = gradient.along(at, across[:, None]) * np.float32(np.sign(ruling.slope))
    least = max(config.min_slope, config.min_slope_share * abs(ruling.slope))
    station, offset, height = _maxima(slopes, steps, least, config)
    position = along[station]
    of_end = np.clip(position, 0.0, 1.0)  # beyond an end as at it
    near = np.abs(offset) <= 3.0 * (sigma[0] + (sigma[1] - sigma[0]) * of_end) + 1.0
    station, offset, height, position = station[near], offset[near], height[near], position[near]
    if len(station) < fewest:
        return None

    line, ambiguous = _vote(position, offset, sigma, config)
    chosen = _inliers(station, position, offset, line, config)
    if len(chosen) < max(fewest, config.min_support * len(along)):
        return None
    station, offset, position = station[chosen], offset[chosen], position[chosen]
    found = camera.undistort(pixels[station] + offset[:, None] * across[station], stations[station])
    if not np.isfinite(found).all():
        return None
    a, b = fit_line(position, offset)
    deviation = float(np.sqrt(np.mean((offset - a - b * position) ** 2)))
    return EdgePoints(
        points=found,
        line=(a, b),
        support=len(chosen) / len(along),
        rms_px=deviation,
        slope=float(np.copysign(np.median(height[chosen]), ruling.slope)),
        ambiguous=ambiguous,
    )


def _maxima(
    slopes: NDArray[np.float32], steps: NDArray[np.int64], least: float, config: EdgesConfig
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Station, offset (px) and height of the local maxima across the ruling, by a parabola."""
    stripe = config.stripe_px
    inner = slopes[:, stripe : slopes.shape[1] - stripe]
    middle, left, right = inner[:, 1:-1], inner[:, :-2], inner[:, 2:]
    around = np.lib.stride_tricks.sliding_window_view(slopes, 2 * stripe + 1, axis=1)
    single = around.min(axis=2)[:, 1:-1] >= -np.float32(config.stripe_share) * middle
    station, column = np.nonzero((middle > least) & (middle >= left) & (middle > right) & single)
    m = middle[station, column].astype(np.float64)
    lft = left[station, column].astype(np.float64)
    rgt = right[station, column].astype(np.float64)
    shift = 0.5 * (lft - rgt) / (lft - 2.0 * m + rgt)
    return station, steps[column + 1 + stripe] + shift, m


def _vote(
    position: FloatArray, offset: FloatArray, sigma: FloatArray, config: EdgesConfig
) -> tuple[tuple[float, float], bool]:
    """The line offset = a + b (2 position - 1) with most candidates near it, less a penalty for its
    distance from the prediction; and whether another comes close.
    """
    s = 2.0 * position - 1.0
    tilt = 3.0 * float(sigma.max())
    slopes = np.arange(-np.ceil(tilt), np.ceil(tilt) + 0.5, 1.0)
    reach = int(np.ceil(np.abs(offset).max() + tilt)) + 2
    bins = 2 * reach + 1
    intercept = offset[:, None] - s[:, None] * slopes
    cell = np.rint(intercept).astype(np.int64) + reach
    valid = (cell >= 0) & (cell < bins)
    flat = (np.arange(len(slopes)) * bins + cell)[valid]
    votes = np.bincount(flat, minlength=len(slopes) * bins).reshape(len(slopes), bins).astype(float)
    smooth = votes.copy()
    smooth[:, 1:] += 0.5 * votes[:, :-1]
    smooth[:, :-1] += 0.5 * votes[:, 1:]
    a = np.arange(bins) - reach
    ends = np.stack([a - slopes[:, None], a + slopes[:, None]])
    away = np.sum((ends / np.maximum(sigma, 0.5)[:, None, None]) ** 2, axis=0)
    score = smooth * np.clip(1.0 - config.sigma_penalty * away, 0.0, None)
    best = np.unravel_index(int(np.argmax(score)), score.shape)
    b0, a0 = float(slopes[best[0]]), float(a[best[1]])
    distance = np.maximum(np.abs(ends[0] - (a0 - b0)), np.abs(ends[1] - (a0 + b0)))
    rival = float(score[distance > config.rival_distance_px].max(initial=0.0))
    return (a0, b0), rival > config.rival_share * float(score[best])


def _inliers(
    station: NDArray[np.int64],
    position: FloatArray,
    offset: FloatArray,
    line: tuple[float, float],
    config: EdgesConfig,
) -> NDArray[np.int64]:
    """Indices of the points on the line, one for each station, after refining it twice."""
    s = 2.0 * position - 1.0
    a, b = line
    # The vote counts in cells of 1 px.
    for tolerance in (config.vote_px + 0.5, config.vote_px, config.inlier_px):
        residual = np.abs(offset - a - b * s)
        order = np.lexsort((residual, station))
        first = np.ones(len(order), dtype=bool)
        first[1:] = station[order][1:] != station[order][:-1]
        chosen = order[first]
        chosen = chosen[residual[chosen] < tolerance]
        if len(chosen) < config.min_points or np.ptp(s[chosen]) < 2.0 * config.min_extent:
            return chosen[:0]
        a, b = fit_line(s[chosen], offset[chosen])
    return np.asarray(chosen)
